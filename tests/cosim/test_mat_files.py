"""Workspaces of MATLAB as measured data: vectors of numbers, all else named."""


import numpy as np
import pytest

from cosim.measured import load
from driveline.quantities import InputError


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_mat_files(tmp_path, version):
    arrays = {"time": np.arange(4) * 0.1, "force": np.arange(4.0) ** 2, "note": "text"}
    if version == "5":
        import scipy.io
        scipy.io.savemat(tmp_path / "a.mat", arrays)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
            for name in ("time", "force"):
                file[name] = arrays[name][np.newaxis, :]
        with open(tmp_path / "a.mat", "r+b") as file:  # the header MATLAB writes before the HDF5 part
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    channel = load(tmp_path / "a.mat").manoeuvres[0]["force"]
    assert channel.values.tolist() == [0.0, 1.0, 4.0, 9.0]
    assert channel.time == pytest.approx([0.0, 0.1, 0.2, 0.3])


def save_mat(path, version, contents):
    """A MAT file of numbers, texts, and structs of them."""
    if version == "5":
        import scipy.io
        scipy.io.savemat(path, contents)
        return
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        for name, values in contents.items():
            for field, of in values.items() if isinstance(values, dict) else [("", values)]:
                place = f"{name}/{field}".rstrip("/")
                kind, empty = "char" if isinstance(of, str) else "double", np.size(of) == 0
                if isinstance(of, str):
                    of = np.frombuffer(of.encode("utf-16-le"), np.uint16)
                file[place] = np.array(np.shape(of), dtype=np.uint64) if empty else np.atleast_2d(of)
                file[place].attrs["MATLAB_class"] = np.bytes_(kind)
                if empty:
                    file[place].attrs["MATLAB_empty"] = np.uint8(1)
    with open(path, "r+b") as file:  # the header MATLAB writes before the HDF5 part
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_the_only_struct_of_a_mat_file_is_opened(tmp_path, version):
    log = {"time": np.arange(4) * 0.1, "force": np.arange(4.0)}
    save_mat(tmp_path / "a.mat", version, {"log": log, "rate": 10.0})
    channel = load(tmp_path / "a.mat").manoeuvres[0]["force"]
    assert channel.values.tolist() == [0.0, 1.0, 2.0, 3.0] and channel.time == pytest.approx(log["time"])
    save_mat(tmp_path / "a.mat", version, {"log": log, "other": {"a": np.arange(3.0)}})
    with pytest.raises(InputError, match="^[^ ]*a.mat holds no vectors of numbers, but a struct log with "
                                         "(time and force|force and time) and a struct other with a: variables"):
        load(tmp_path / "a.mat")
    save_mat(tmp_path / "a.mat", version, {"map": np.ones((2, 3))})
    with pytest.raises(InputError, match=r"numbers, but map \(2x3\): variables"):
        load(tmp_path / "a.mat")
    save_mat(tmp_path / "a.mat", version, {})
    with pytest.raises(InputError, match="^[^ ]*a.mat holds no vectors of numbers: variables that are vectors"):
        load(tmp_path / "a.mat")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_neither_a_text_nor_an_empty_array_of_a_mat_file_is_a_vector(tmp_path, version):
    log = {"time": np.arange(4) * 0.1, "force": np.arange(4.0), "unit": "newton"}
    save_mat(tmp_path / "a.mat", version, {"log": log, "note": "drive on the track", "nothing": np.zeros((0, 0))})
    assert load(tmp_path / "a.mat").manoeuvres[0]["force"].values.tolist() == [0.0, 1.0, 2.0, 3.0]
    save_mat(tmp_path / "a.mat", version, {"log": log | {"force": "none"}, "note": "drive on the track"})
    with pytest.raises(InputError, match="no column bears a canonical name.* there are time$"):
        load(tmp_path / "a.mat")


def test_a_damaged_mat_file_is_named_in_one_short_line(tmp_path):
    h5py = pytest.importorskip("h5py")
    import scipy.io

    path, log = tmp_path / "a.mat", {"time": np.arange(4) * 0.1, "force": np.arange(4.0)}
    save_mat(path, "7.3", log)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"SNOD", b"????"))
    with pytest.raises(InputError, match="a.mat is not a readable MAT file: [^\\n]{,210}$"):
        load(path)
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.create_dataset("endless", (1, 10**15), chunks=(1, 8), dtype=float)
    with pytest.raises(InputError, match="a.mat is not a readable MAT file: [^\\n]{,210}$"):
        load(path)
    scipy.io.savemat(path, {**log, "position": np.arange(1000.0)}, format="4")
    whole = path.read_bytes()
    at = whole.index(b"position")
    path.write_bytes(whole[:at - 4] + (5000).to_bytes(4, "little") + whole[at:])  # bytes of the name
    with pytest.raises(InputError, match="a.mat is not a readable MAT file: [^\\n]{,210}$"):
        load(path)


def test_an_object_of_a_mat_file_is_no_vector(tmp_path):
    """A datetime, say: where MATLAB keeps its contents is a few whole numbers in its place."""
    h5py = pytest.importorskip("h5py")
    place = np.array([0xDD000000, 2, 1, 1, 1, 1], dtype=np.uint32)
    save_mat(tmp_path / "a.mat", "7.3", {"time": np.arange(6) * 0.1, "force": place, "position": np.arange(6.0)})
    with h5py.File(tmp_path / "a.mat", "r+") as file:
        file["force"].attrs.update({"MATLAB_class": np.bytes_("datetime"), "MATLAB_object_decode": np.int32(3)})
    assert set(load(tmp_path / "a.mat").manoeuvres[0].channels) == {"position"}


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_complex_numbers_are_not_made_real(tmp_path, version):
    parts = np.arange(4.0) * (1.0 + 2.0j)
    if version == "7.3":  # as MATLAB writes them
        parts = np.array(list(zip(parts.real, parts.imag)), dtype=[("real", float), ("imag", float)])
    save_mat(tmp_path / "a.mat", version, {"time": np.arange(4) * 0.1, "force": np.arange(4.0), "position": parts})
    with pytest.raises(InputError, match="a.mat: column 'position' holds complex numbers"):
        load(tmp_path / "a.mat")
    assert set(load(tmp_path / "a.mat", {"channels": {"force": {}}}).manoeuvres[0].channels) == {"force"}
