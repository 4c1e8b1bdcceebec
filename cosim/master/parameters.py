"""The models of the payload by name, and their parameters from a vehicle file."""

from __future__ import annotations

from pathlib import Path

from cosim.messages import did_you_mean
from driveline.model import Model
from driveline.quantities import InputError, declared


def model_class(name: str) -> type[Model]:
    """The model called ``name``.

    Raises:
        InputError: There is none.
    """
    from driveline.models import MODELS  # not needed, and not loaded, for somebody else's FMUs

    if name not in MODELS:
        raise InputError(f"there is no model '{name}'{did_you_mean(name, MODELS)}")
    return MODELS[name]


def vehicle_parameters(model: str, vehicle: str | Path, variant: str | None, gear: int) -> dict[str, float]:
    """The parameters of ``model`` for a vehicle file in one gear, computed, not typed again.

    Raises:
        InputError: No such model, vehicle, variant or gear.
    """
    from driveline import vehicles

    return model_class(model).defaults_from(vehicles.load(vehicle, variant), gear=gear)


def why_strange(model: str, name: str) -> str:
    """Why a parameter that ``vehicle_parameters`` gives is not there: of another FMU, or never declared."""
    kind = model_class(model)
    bare = name.partition("[")[0]
    if bare in declared(kind.Parameters) or name in {v.name for v in kind.inputs}:
        return (f"a vehicle file gives {name}, which this FMU does not have but the model '{model}' has: it was built "
                "from other sources, run `driveline build`")
    return (f"defaults_from of the model '{model}' gives {name}, which its Parameters do not declare: it has to be "
            "declared there, or left out")


def twin_of(name: str) -> Model:
    """The model called ``name``, with the start values its FMU is built with."""
    from driveline.models import SHIPPED_GEAR, SHIPPED_VARIANT, SHIPPED_VEHICLE

    return model_class(name)(vehicle_parameters(name, SHIPPED_VEHICLE, SHIPPED_VARIANT, SHIPPED_GEAR))


def find_fmu(name: str | Path, beside: Path | None = None) -> Path:
    """The FMU file meant by a path, or by a name to be found among the built ones.

    Args:
        name: Path of an ``.fmu`` file, or the name of one in ``build/fmus``.
        beside: Folder that relative paths may also start from.

    Raises:
        InputError: There is none; the message says where it was looked for, or which names there are.
    """
    starts = [folder for folder in (beside, Path.cwd()) if folder is not None]
    if Path(name).suffix == ".fmu" or len(Path(name).parts) > 1:
        found = [start / name for start in starts if (start / name).is_file()]
        if not found:
            raise InputError(f"there is no FMU {name}")
        return found[0]
    built = {path.stem: path for folder in reversed(build_folders()) for path in sorted(folder.glob("*.fmu"))}
    if str(name) not in built:
        from driveline.models import MODELS

        if str(name) in MODELS:
            folders = " and ".join(str(folder) for folder in build_folders())
            raise InputError(f"there is no FMU '{name}' in {folders}: run `driveline build`")
        raise InputError(f"there is no FMU '{name}': the path of an .fmu file is needed, or the name of one of the "
                         f"project's{did_you_mean(str(name), {*MODELS, *built}, 20)}")
    return built[str(name)]


def build_folders() -> list[Path]:
    """Where built FMUs are looked for, the first first."""
    folders = [Path.cwd() / "build" / "fmus", Path(__file__).parents[2] / "build" / "fmus"]
    return list(dict.fromkeys(folders))
