"""Joints of an assembly are chosen on a page, built, and chosen again; what is written is what the command line writes."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.imports.build import Import
from mbd_sim.imports.choice import choose
from mbd_sim.imports.masses import mass_table
from test.imports.test_choice import assembly, candidates

pytest.importorskip("viser")

from mbd_sim.base.errors import InputError
from mbd_sim.lab.joints.assembly_scene import labels
from mbd_sim.lab.joints.import_lab import ImportLab


def imported(out, density="steel"):
    table = mass_table([density] if density else [], [], None)
    return Import(assembly(), table, tuple(candidates()), out, "z")


def chosen(found, *picks, ground=None):
    return choose(found.assembly, found.candidates, False, picks, ground)


def test_joints_at_one_place_have_one_label():
    near, far = candidates()[:2], candidates()[2:]
    assert [text for _, text in labels([*near, *far], 0.01)] == ["1, 3", "2"]


def test_a_part_without_a_mass_is_refused_before_the_page_opens(tmp_path):
    found = imported(tmp_path / "m.yaml", density="")
    with pytest.raises(InputError, match="neither density nor mass of frame is known"):
        ImportLab(found, chosen(found), port=0)


def test_what_the_page_builds_is_what_the_command_line_writes(tmp_path):
    """With another ground, a joint of another type and one without a type; a file that was edited is not replaced."""
    found = imported(tmp_path / "m.yaml")
    other = Import(found.assembly, found.table, found.candidates, tmp_path / "n" / "m.yaml", "z")
    other.write(chosen(other, "1=slider", "2", ground="Ω"))
    with ImportLab(found, chosen(found, "2"), port=0) as lab:
        page = lab.page
        assert page.choice() == chosen(found, "2")
        page._types[1].value = "slider"
        page._ground.value = "Ω"
        page._start()
        assert found.out.read_text(encoding="utf-8") == other.out.read_text(encoding="utf-8")
        assert lab.lab.session.bench.simulation.coordinate_names
        found.out.write_text(found.out.read_text(encoding="utf-8") + "# mine\n", encoding="utf-8")
        lab._back()
        page = lab.page
        assert page.choice() == chosen(found, "1=slider", "2", ground="Ω")  # as it was left
        page._start()
        assert "has been changed" in page._problem.content
        assert found.out.read_text(encoding="utf-8").endswith("# mine\n")
        page._replace.value = True
        page._take("none")
        page._start()
        assert not load_mechanism(found.out).joints["arm.left_mount"].kind.coordinates
