"""The run over a folder of robots prints a row for each, whatever becomes of it."""

import sys

from benchmarks import urdf_robots

LINK = '<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0 0 -0.3"/>{inertia}</inertial></link>'
INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
JOINT = """<joint name="pin" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="{axis}"/>
<dynamics damping="{damping}"/></joint>"""


def robot(name, axis="0 1 0", mass=1.0, inertia=INERTIA, damping=0.0):
    arm = LINK.format(name="arm", mass=mass, inertia=inertia)
    return f'<robot name="{name}"><link name="base"/>{arm}{JOINT.format(axis=axis, damping=damping)}</robot>'


def run(folder, monkeypatch, capsys, *options):
    monkeypatch.setattr(sys, "argv", ["urdf_robots", str(folder), "--seconds", "0.1", *options])
    status = urdf_robots.main()
    head, *rows, summary = capsys.readouterr().out.splitlines()
    assert "residual" in head
    return status, rows, summary


def test_each_robot_has_a_row_and_refused_ones_say_why(tmp_path, monkeypatch, capsys):
    (tmp_path / "more").mkdir()
    arm = tmp_path / "more" / "arm.urdf"
    arm.write_text(robot("arm", axis="1 1 0"))
    (tmp_path / "massless.urdf").write_text(robot("massless", mass=0.0, inertia=INERTIA.replace("0.01", "0")))
    found = []

    def here_and_apart(file, options, step):
        found.append(urdf_robots.run_robot(file, options.seconds, step, options.method))
        return apart(file, options, step) if file == arm else found[-1]

    apart = urdf_robots.run_apart
    monkeypatch.setattr(urdf_robots, "run_apart", here_and_apart)
    status, (first, second), summary = run(tmp_path, monkeypatch, capsys)
    assert urdf_robots.row("arm", found[1])[:90] == second[:90]
    assert first.startswith("massless") and "refused" in first and "joint[pin]" in first
    assert second.split()[:4] == ["arm", "1", "adams11", "0.001"]
    assert status == 0 and summary.startswith("1 of 2 robots ran to the end, 0 of them with a smaller step; 0 diverged")


def test_a_robot_that_diverges_is_run_again_with_smaller_steps(tmp_path, monkeypatch, capsys):
    (tmp_path / "stiff.urdf").write_text(robot("stiff", damping=10.0).replace('xyz="0 0 -0.3"', 'xyz="0.3 0 0"'))
    monkeypatch.setattr(
        urdf_robots,
        "run_apart",
        lambda file, options, step: urdf_robots.run_robot(file, options.seconds, step, options.method),
    )
    options = ("--method", "tsitouras8", "--step", "0.16", "--seconds", "50")
    status, rows, summary = run(tmp_path, monkeypatch, capsys, *options)
    steps = [float(line.split()[3]) for line in rows]
    assert steps == [0.16 / 2**index for index in range(len(rows))] and len(rows) > 1
    assert all("diverged" in line for line in rows[:-1]) and "diverged" not in rows[-1]
    assert status == 0 and "1 of them with a smaller step" in summary
