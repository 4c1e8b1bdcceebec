"""The generated pages are what the declarations say now."""

import pytest

from docs import generate


@pytest.mark.parametrize("file", generate.PAGES)
def test_the_page_is_up_to_date(file):
    page = (generate.FOLDER / file).read_text(encoding="utf-8")
    assert page == generate.page(generate.PAGES[file]), "run python -m docs.generate"


def test_every_variable_of_a_plant_is_on_its_page():
    page = generate.page(("plant_fom",))
    model = generate.MODELS["plant_fom"](
        generate.MODELS["plant_fom"].defaults_from(generate.vehicles.load(generate.VEHICLE)))
    for variable in model.variables:
        assert variable.name.partition("[")[0] in page
        assert variable.meaning in page
