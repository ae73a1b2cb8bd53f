"""Play, pause, step, reset, the speed and the time line, by buttons and by keys."""

from test.waiting import wait_until


def test_play_pause_step_and_reset(opened):
    opened.button("Play")
    wait_until(lambda: opened.frame.running and opened.frame.time > 0.1, "the run")
    opened.button("Pause")
    wait_until(lambda: not opened.frame.running, "the pause")
    paused = opened.frame.time
    opened.button("Step")
    wait_until(lambda: opened.frame.time > paused, "the step")
    opened.button("Reset")
    wait_until(lambda: opened.frame.time == 0.0, "the reset")


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
    speed = opened.lab.page._run_bar._speed
    opened.select("Speed", "1/100", speed)
    wait_until(lambda: opened.lab.session.speed == 0.01, "the speed")
    opened.select("Speed", "fastest", speed)
    wait_until(lambda: opened.lab.session.speed == float("inf"), "the speed")
    opened.select("Speed", "1", speed)
    wait_until(lambda: opened.lab.session.speed == 1.0, "the speed")


def test_winding_back_by_the_time_line(opened):
    opened.button("Play")
    wait_until(lambda: opened.frame.time > 0.5, "the run")
    opened.button("Pause")
    wait_until(lambda: not opened.frame.running, "the pause")
    reached = opened.frame.time
    wait_until(lambda: abs(opened.lab.page._run_bar.time.value - reached) < 1e-3, "the paused time in the page")
    opened.enter(
        "Time (s)",
        "0.2",
        lambda: opened.frame.time < 0.5 * (0.2 + reached),
        "the wound back time",
        report=lambda: f"{reached:g} s were reached; now {opened.frame.time:g} s",
    )
