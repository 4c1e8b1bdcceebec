"""What is generated in the documentation is what the declarations and the results say now."""

import pytest

from docs import generate


@pytest.fixture(scope="module")
def pages():
    return generate.pages()


def test_everything_is_up_to_date(pages):
    old = [path.name for path, text in pages.items() if path.read_text(encoding="utf-8") != text]
    assert not old, "run python -m docs.generate"


def test_every_variable_of_a_plant_is_on_its_page(pages):
    page = pages[generate.FOLDER / "plants/plant_fom_variables.md"]
    model = generate.MODELS["plant_fom"](
        generate.MODELS["plant_fom"].defaults_from(generate.vehicles.load(generate.SHIPPED_VEHICLE)))
    for variable in model.variables:
        assert variable.name.partition("[")[0] in page
        assert variable.meaning in page


def test_every_effect_is_on_the_page_with_all_its_parameters(pages):
    page = pages[generate.FOLDER / "effects.md"]
    for name, effect in generate.CATALOGUE.items():
        assert f"## {name}\n" in page
        assert all(f"`{parameter.name}`" in page for parameter in effect.parameters)


def test_the_readme_counts_them(pages):
    readme = pages[generate.README]
    assert f"[{len(generate.CATALOGUE)} effects](docs/effects.md)" in readme
    assert generate.with_tables(readme.replace(f"[{len(generate.CATALOGUE)} effects]", "[7 effects]")) == readme


def test_results_that_are_kept_are_those_of_studies_that_exist(pages):
    page = pages[generate.FOLDER / "results.md"]
    kept = [path.stem for path in generate.RESULTS.glob("*.json")]
    assert kept
    for name in kept:
        assert name in generate.studies.STUDIES
        assert f"## {name}\n" in page


def test_the_table_of_the_readme_is_what_the_studies_gave(pages):
    assert generate.main_table() in pages[generate.README]
    study, quantity, _ = generate.MAIN_TABLE[0]
    (row,) = (row for row in generate.results()[study]["rows"] if row["quantity"] == quantity)
    assert f"{row['here']:.4g}" in generate.main_table()


def test_the_picture_can_be_drawn(tmp_path):
    generate.draw_tip_in(tmp_path / "tip_in.png")
    assert (tmp_path / "tip_in.png").read_bytes().startswith(b"\x89PNG")
