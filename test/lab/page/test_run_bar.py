"""Play, pause, step, reset, the speed and the time line, by buttons and by keys."""

from test.waiting import wait_until


def test_play_pause_step_and_reset(opened):
    opened.press("Play", lambda: opened.frame.running and opened.frame.time > 0.1, "the run")
    opened.press("Pause", lambda: not opened.frame.running, "the pause")
    paused = opened.frame.time
    opened.press("Step", lambda: opened.frame.time > paused, "the step")
    opened.press("Reset", lambda: opened.frame.time == 0.0, "the reset")


def test_keys(opened):
    opened.page.evaluate("document.activeElement.blur()")  # no control takes the keys
    opened.page.keyboard.press("Space")
    wait_until(lambda: opened.frame.running and opened.frame.time > 0.2, "the run")
    opened.page.keyboard.press("Space")
    wait_until(lambda: not opened.frame.running, "the pause")
    paused = opened.frame.time
    opened.page.keyboard.press("ArrowRight")
    wait_until(lambda: opened.frame.time > paused, "the step")
    opened.page.keyboard.press("ArrowLeft")
    wait_until(lambda: opened.frame.time == paused, "the step back")
    opened.page.keyboard.press("Home")
    wait_until(lambda: opened.frame.time == 0.0, "the reset")


def test_the_speed(opened):
    for name, speed in (("1/100", 0.01), ("fastest", float("inf")), ("1", 1.0)):
        opened.select("Speed", name, lambda speed=speed: opened.lab.session.speed == speed, f"the speed {name}")


def test_winding_back_by_the_time_line(opened):
    opened.press("Play", lambda: opened.frame.time > 0.5, "the run")
    opened.press("Pause", lambda: not opened.frame.running, "the pause")
    reached = opened.frame.time
    wait_until(lambda: abs(opened.lab.page._run_bar.time.value - reached) < 1e-3, "the paused time in the page")
    opened.enter(
        "Time (s)",
        "0.2",
        lambda: opened.frame.time < 0.5 * (0.2 + reached),
        "the wound back time",
        report=lambda: f"{reached:g} s were reached; now {opened.frame.time:g} s",
    )
