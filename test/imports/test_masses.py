import pytest

from mbd_sim import InputError, MechanismError
from mbd_sim.imports.masses import mass_table


def test_named_densities_count_after_general_ones_and_those_of_a_file(tmp_path):
    file = tmp_path / "table.yaml"
    file.write_text("'*': 1000\nrod*: brass\n")
    table = mass_table(["piston*=2.7 g/cm**3", "aluminium"], ["pin=20 g"], file)
    assert [(name, material.density, material.name) for name, material in table.materials] == [
        ("*", 1000.0, ""),
        ("rod*", 8500.0, "brass"),
        ("*", 2700.0, "aluminium"),
        ("piston*", pytest.approx(2700.0), ""),
    ]
    assert table.masses == (("pin", pytest.approx(0.02)),)


@pytest.mark.parametrize(
    ("densities", "masses", "said"),
    [
        (["stel"], [], "--density stel: unknown material 'stel'. Did you mean 'steel'?"),
        (["rod=-3"], [], "--density -3: must be a positive number"),
        (["rod=3 m"], [], "--density 3 m: "),
        ([], ["rod"], "--mass rod: a name and a mass are needed"),
    ],
)
def test_wrong_entries_are_refused(densities, masses, said):
    with pytest.raises(InputError) as error:
        mass_table(densities, masses, None)
    assert str(error.value).startswith(said)


def test_a_wrong_table_names_file_and_line(tmp_path):
    file = tmp_path / "table.yaml"
    file.write_text("a: steel\nb: stel\n")
    with pytest.raises(InputError, match=r"table\.yaml:2: b: unknown material 'stel'"):
        mass_table([], [], file)
    file.write_text("- steel\n")
    with pytest.raises((InputError, MechanismError), match="must map names"):
        mass_table([], [], file)
