"""FMUs run in FMPy as the mechanism runs here: co-simulation to the bit, model exchange to the solver's tolerance."""

import itertools
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.analysis.linear.linearization import linearize
from mbd_sim.base.errors import InputError
from mbd_sim.cli.main import main
from mbd_sim.exports.c_code.model import export_model
from mbd_sim.exports.fmu import archive
from mbd_sim.exports.fmu.archive import entries, write_fmu
from mbd_sim.files.load import load_mechanism, parse_mechanism
from test.generators.sampled_arm import sampled_arm

fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install fmpy")
if not shutil.which("gcc"):
    pytest.skip("gcc is not installed", allow_module_level=True)

SAMPLED = sampled_arm("sampled")


class Unit:
    """An FMU on disk, and the model that it was made of.

    Its bits do not depend on the optimization, which takes most of the time: only some are compiled `as_users` do.
    """

    def __init__(self, folder, mechanism, *, as_users=False, **options):
        self.mechanism, self.model = mechanism, export_model(mechanism, **options)
        self.path = Path(folder, f"{mechanism.name}.fmu")
        with pytest.MonkeyPatch.context() as patch:
            if not as_users:
                patch.setattr(archive, "FLAGS", tuple(flag.replace("-O3", "-O0") for flag in archive.FLAGS))
            write_fmu(self.model, self.path)
        self.extracted = fmpy.extract(self.path, unzipdir=Path(folder, mechanism.name))
        self.description = fmpy.read_model_description(self.extracted)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.names = [variable.name for variable in self.model.states]

    def state(self, instance):
        return np.array(instance.getFloat64([self.references[name] for name in self.names]))

    def instance(self, kind="CoSimulation", *, initialized=True):
        found = fmpy.instantiate_fmu(self.extracted, self.description, kind)
        if initialized:
            found.enterInitializationMode(startTime=0.0)
            found.exitInitializationMode()
        return found


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    return Unit(tmp_path_factory.mktemp("loop"), load_mechanism("four_bar"), parameters=["coupler"])


@pytest.fixture(scope="module")
def rod(tmp_path_factory):
    return Unit(tmp_path_factory.mktemp("rod"), load_mechanism("rod_pendulum"), as_users=True)


@pytest.fixture(scope="module")
def rods(tmp_path_factory):
    mechanism = load_mechanism("double_rod")
    return Unit(tmp_path_factory.mktemp("rods"), mechanism, method="rk4", parameters=["l"])


@pytest.fixture(scope="module")
def sampled(tmp_path_factory):
    return Unit(tmp_path_factory.mktemp("sampled"), parse_mechanism(SAMPLED))


@pytest.mark.parametrize("name", ["loop", "rod", "sampled"])
def test_fmpy_finds_no_problem(name, request):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(request.getfixturevalue(name).path)) == []


def test_co_simulation_has_the_bits_of_the_simulation(rod):
    (pin,) = rod.mechanism.coordinate_names
    effort = np.array(
        [(0.0, 0.0), (0.1, 0.0), (0.1, 2.0), (0.3, 2.0)], dtype=[("time", float), (f"{pin}.effort", float)]
    )
    result = fmpy.simulate_fmu(
        rod.extracted, stop_time=0.3, output_interval=0.01, input=effort, output=[*rod.names, "kinetic_energy"]
    )
    simulation = Simulation(rod.mechanism)  # with adams11, whose history is part of the unit's state
    simulation.run(until=0.1)
    simulation.set_efforts({pin: 2.0})
    simulation.run(until=0.3)
    assert np.array_equal([result[name][-1] for name in rod.names], simulation.y)
    assert result["kinetic_energy"][-1] == simulation.energies.kinetic
    assert simulation.energies.work_applied != 0.0


def test_implicit_methods_have_the_bits_of_the_simulation(tmp_path):
    unit = Unit(tmp_path, load_mechanism("rod_pendulum"), method="rosenbrock")
    result = fmpy.simulate_fmu(unit.extracted, stop_time=0.2, output_interval=0.01, output=unit.names)
    simulation = Simulation(unit.mechanism, method="rosenbrock")
    simulation.run(until=0.2)
    assert np.array_equal([result[name][-1] for name in unit.names], simulation.y)


def test_model_exchange_agrees_to_the_tolerance_of_the_solver(loop):
    result = fmpy.simulate_fmu(
        loop.extracted,
        fmi_type="ModelExchange",
        stop_time=0.2,
        output_interval=0.1,
        relative_tolerance=1e-10,
        output=loop.names,
    )
    simulation = Simulation(loop.mechanism)
    simulation.run(until=0.2)
    found = np.array([result[name][-1] for name in loop.names])
    assert np.allclose(found, simulation.y, rtol=0, atol=2e-7)
    assert simulation.model.violation(0.2, found).position < 1e-8


def test_pressures_have_nominal_values_and_agree_relative_to_them(tmp_path):
    """A motion of 0.1 s of a cylinder: the pressures of some MPa agree to 1e-7 of them, not to fractions of a pascal."""
    lift = Unit(tmp_path, load_mechanism("hydraulic_scissor_lift"))
    nominals = np.array([state.nominal for state in lift.model.states])
    declared = {variable.name: variable.nominal for variable in lift.description.modelVariables}
    pressures = [name for name in lift.names if "pressure" in name]
    assert [declared[name] for name in pressures] == ["4900000.0", "1000000.0"]
    with_nominals = lift.instance("ModelExchange", initialized=False)
    values = (fmpy.fmi3.fmi3Float64 * len(nominals))()
    with_nominals.getNominalsOfContinuousStates(values, len(nominals))
    assert np.array_equal(values, nominals) and np.min(nominals) == 1.0
    with_nominals.freeInstance()
    result = fmpy.simulate_fmu(
        lift.extracted, fmi_type="ModelExchange", stop_time=0.1, relative_tolerance=1e-10, output=lift.names
    )
    simulation = Simulation(lift.mechanism)
    simulation.run(until=0.1)
    found = np.array([result[name][-1] for name in lift.names])
    assert np.max(np.abs(found - simulation.y) / nominals) < 1e-7


def test_parameters_are_tunable(rods):
    result = fmpy.simulate_fmu(
        rods.extracted,
        stop_time=0.5,
        output_interval=0.1,
        start_values={"l": 0.8},
        output=[*rods.names, "lower.tip.z.position"],
    )
    simulation = Simulation(rods.mechanism, method="rk4", parameters={"l": 0.8})
    simulation.run(until=0.5)
    assert np.allclose([result[name][-1] for name in rods.names], simulation.y, rtol=0, atol=1e-12)
    assert result["lower.tip.z.position"][-1] == pytest.approx(simulation.point("lower.tip").position[2], abs=1e-12)


def test_sampled_controllers_act_as_in_the_simulation(sampled):
    assert sampled.description.modelExchange is None
    result = fmpy.simulate_fmu(
        sampled.extracted,
        stop_time=0.2,
        output_interval=0.01,
        start_values={"drive.position.command": 0.4},
        output=sampled.names,
    )
    simulation = Simulation(sampled.mechanism)
    simulation.set_commands({"drive": 0.4})
    simulation.run(until=0.2)
    assert np.array_equal([result[name][-1] for name in sampled.names], simulation.y)
    unit = sampled.instance()
    with pytest.raises(Exception, match="fmi3DoStep"):
        unit.doStep(0.0, 0.0015)
    unit.freeInstance()


def test_communication_steps_need_not_be_multiples(rods):
    unit, simulation = rods.instance(), Simulation(rods.mechanism, method="rk4")
    times = np.linspace(0.0, 0.5, 72)
    for begin, end in itertools.pairwise(times):
        unit.doStep(begin, end - begin)
    simulation.run(until=0.5)
    assert np.allclose(rods.state(unit), simulation.y, rtol=0, atol=1e-9)  # the error of RK4
    unit.freeInstance()


def test_a_saved_state_goes_on_with_the_same_bits(rod):
    made, unit = rod, rod.instance()
    unit.doStep(0.0, 0.1)
    saved = unit.getFMUState()
    contents = unit.serializeFMUState(saved)
    unit.doStep(0.1, 0.1)
    expected = made.state(unit)
    unit.setFMUState(saved)
    unit.doStep(0.1, 0.1)
    assert np.array_equal(made.state(unit), expected)
    other = made.instance()
    other.setFMUState(other.deserializeFMUState(contents))
    other.doStep(0.1, 0.1)
    assert np.array_equal(made.state(other), expected)
    unit.freeFMUState(saved)
    for one in (unit, other):
        one.freeInstance()


def test_directional_derivatives_are_those_of_the_linearization(rods):
    simulation = Simulation(rods.mechanism)
    linear = linearize(simulation.model.equations, simulation.q, simulation.u, simulation.efforts)
    unit = rods.instance("ModelExchange")
    states = [rods.references[name] for name in rods.names[:4]]
    rates = [rods.references[f"der({name})"] for name in rods.names[:4]]
    efforts = [rods.references[f"{name}.effort"] for name in ("shoulder", "elbow")]

    def columns(knowns):
        return np.array([unit.getDirectionalDerivative(rates, [known], [1.0]) for known in knowns]).T

    assert np.allclose(columns(states), linear.a, rtol=1e-12, atol=1e-11)
    assert np.allclose(columns(efforts), linear.b, rtol=1e-12, atol=1e-12)
    tip, length = rods.references["upper.tip.x.position"], rods.references["l"]
    assert unit.getDirectionalDerivative([tip], [length], [1.0]) == pytest.approx([np.sin(simulation.q[0])])
    unit.freeInstance()


def test_loops_are_closed_from_start_values_or_these_are_refused(loop):
    unit = loop.instance(initialized=False)
    at = loop.references["crank_pivot.position"]
    unit.enterInitializationMode(startTime=0.0)
    unit.setFloat64([at], [loop.model.states[0].start + 0.05])
    unit.exitInitializationMode()
    y, simulation = loop.state(unit), Simulation(loop.mechanism)
    assert simulation.model.violation(0.0, y).position < 1e-12
    assert y[0] != loop.model.states[0].start
    with pytest.raises(Exception, match="fmi3SetFloat64"):  # after the initialization
        unit.setFloat64([at], [0.0])
    unit.freeInstance()


def test_the_start_follows_changed_parameters(loop):
    made, length = loop, loop.references["coupler"]
    simulation = Simulation(made.mechanism, parameters={"coupler": 1.3})
    crank = made.references["crank_pivot.position"]
    unit = made.instance(initialized=False)
    unit.enterInitializationMode(startTime=0.0)
    unit.setFloat64([length], [1.3])
    assert np.allclose(made.state(unit), simulation.y, rtol=0, atol=1e-12)  # before the end of the initialization too
    unit.setFloat64([crank], [1.2])
    unit.exitInitializationMode()
    simulation.reset(q={"crank_pivot": 1.2})
    assert made.state(unit)[0] == 1.2
    assert np.allclose(made.state(unit), simulation.y, rtol=0, atol=1e-12)
    unit.freeInstance()
    messages = []
    short = fmpy.instantiate_fmu(
        made.extracted, made.description, "CoSimulation", logger=lambda *given: messages.append(given[-1].decode())
    )
    short.enterInitializationMode(startTime=0.0)
    short.setFloat64([length], [0.1])
    with pytest.raises(Exception, match="fmi3ExitInitializationMode"):
        short.exitInitializationMode()
    assert any("loops do not close" in message for message in messages)
    short.freeInstance()


def test_the_functions_have_the_signatures_of_the_standard(rods):
    headers = Path(fmpy.__file__).parent / "c-code"
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-strict-prototypes", "-fsyntax-only"]
    source = Path(rods.extracted, "sources", "fmi3_functions.c")
    subprocess.run(["gcc", *flags, f"-I{headers}", '-DFMI3_HEADER="fmi3Functions.h"', source], check=True)
    declared = (headers / "fmi3Functions.h").read_text(encoding="utf-8")
    library = next(Path(rods.extracted, "binaries").rglob("*.so"))
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    defined = {line.split()[-1] for line in symbols.splitlines()}
    needed = {line.split()[1].rstrip(";") for line in declared.splitlines() if line.startswith("FMI3_Export ")}
    names = {name.removesuffix("TYPE") for name in needed}
    assert len(names) > 70
    assert defined == names


def test_an_fmu_of_another_model_is_refused(rods):
    messages = []
    other = fmpy.read_model_description(rods.extracted)
    other.guid = other.instantiationToken = "another"
    with pytest.raises(Exception, match="nstantiate"):
        fmpy.instantiate_fmu(
            rods.extracted, other, "CoSimulation", logger=lambda *given: messages.append(given[-1].decode())
        )
    assert any("instantiation token" in message for message in messages)


def test_the_same_mechanism_gives_the_same_bytes(tmp_path):
    for name in ("one.fmu", "two.fmu"):
        assert main(["fmu", "double_rod", "--sources-only", "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "one.fmu").read_bytes() == (tmp_path / "two.fmu").read_bytes()


def test_without_a_compiler_the_error_says_what_to_do(tmp_path, rods, monkeypatch):
    monkeypatch.setattr(archive.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match=r"apt install gcc.*--sources-only"):
        write_fmu(rods.model, tmp_path / "rods.fmu")


def test_a_parameter_with_the_name_of_another_variable_gets_a_longer_one():
    text = SAMPLED.replace("mass: 1 kg", "mass: dissipated").replace("parts:", "parameters: {dissipated: 1 kg}\nparts:")
    names = [entry.variable.name for entry in entries(export_model(parse_mechanism(text), parameters=["dissipated"]))]
    assert "parameters.dissipated" in names
    assert len(set(names)) == len(names)


def test_another_suffix_is_refused(capsys):
    assert main(["fmu", "double_rod", "--out", "rods.zip"]) == 1
    assert "rods.fmu" in capsys.readouterr().err
