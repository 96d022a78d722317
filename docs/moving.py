#!/usr/bin/env python3
"""Measures the window under the hand: pictures a second of a drag, the time from its release to the final picture, and
from the start of the program to the first picture and to the final one. docs/performance.md has what was measured.

    python3 docs/moving.py [--program target/release/glint] [--seconds 6] [--times 3] INPUT...

INPUT is a file or a built-in scene. Each is opened with empty caches, then again with what that has kept; then it is
dragged in circles. Medians are printed, of glint by its event log. A last drag, with GLINT_EVENT_FLIP, compares moving
pictures with the pictures at rest of the same views, so that a rate never stands without its quality. Where
CloudCompare is found, it is opened and dragged beside glint, and both are counted from outside by ffmpeg, which takes
processor time of its own; what CloudCompare asks about a file is accepted. Needs Xvfb and xdotool, and ffmpeg for
CloudCompare."""

import argparse
import json
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

SIZE = [1400, 900]
PANEL = 310
PATIENCE = 180


class Screen:
    """An X server of its own."""

    def __init__(self):
        read, write = os.pipe()
        size = "x".join(map(str, SIZE)) + "x24"
        arguments = ["Xvfb", "-displayfd", str(write), "-screen", "0", size]
        self.server = subprocess.Popen(arguments, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as numbers:
            self.display = ":" + numbers.readline().strip()

    def xdotool(self, *words):
        environment = {**os.environ, "DISPLAY": self.display}
        arguments = ["xdotool", *map(str, words)]
        return subprocess.run(arguments, env=environment, capture_output=True, text=True).stdout.split()

    def enlarge(self, process):
        """Makes the last window of a process as large as the screen."""
        windows = self.xdotool("search", "--onlyvisible", "--pid", process.pid)
        if windows:
            self.xdotool("windowmove", windows[-1], 0, 0, "windowsize", windows[-1], *SIZE)
            self.xdotool("windowfocus", windows[-1])

    def drag(self, seconds):
        """Drags in circles for so many seconds, and releases the button."""
        middle = [PANEL + (SIZE[0] - PANEL) // 2, SIZE[1] // 2]
        environment = {**os.environ, "DISPLAY": self.display}
        self.xdotool("mousemove", *middle)
        time.sleep(1.0)
        self.xdotool("mousedown", 1)
        with subprocess.Popen(["xdotool", "-"], env=environment, stdin=subprocess.PIPE, text=True) as hand:
            began = time.time()
            while (passed := time.time() - began) < seconds:
                turn = passed * 2.0 * math.pi / 4.0
                place = [middle[0] + 60 * math.sin(turn), middle[1] + 24 * (1.0 - math.cos(turn))]
                hand.stdin.write("mousemove {:.0f} {:.0f}\n".format(*place))
                hand.stdin.flush()
                time.sleep(1 / 60)
        self.xdotool("mouseup", 1)
        return time.time()

    def record(self, seconds):
        """Starts to record the picture beside the panel; `changes` reads the result."""
        area = f"{SIZE[0] - PANEL}x{SIZE[1] - 60}"
        screen = ["-f", "x11grab", "-framerate", "60", "-video_size", area, "-i", f"{self.display}+{PANEL},30"]
        # The times of the frames are those of the clock.
        arguments = ["ffmpeg", "-loglevel", "error", "-draw_mouse", "0", "-t", str(seconds), *screen]
        return subprocess.Popen([*arguments, "-copyts", "-f", "framecrc", "-"], stdout=subprocess.PIPE, text=True)

    def end(self):
        self.server.terminate()
        self.server.wait()


def changes(recording):
    """When the recorded picture changed, in seconds of the clock."""
    lines = [line.split(",") for line in recording.communicate()[0].splitlines() if not line.startswith("#")]
    frames = [(int(words[2]) / 60.0, words[-1].strip()) for words in lines]
    return [at for (_, before), (at, now) in zip(frames, frames[1:]) if now != before]


class Glint:
    """The program in a window, and the events that it has written, each with the time when it was read."""

    def __init__(self, screen, program, scene, home, **environment):
        self.log = os.path.join(home, "events.jsonl")
        if os.path.exists(self.log):
            os.remove(self.log)
        folders = {"HOME": home, "XDG_CACHE_HOME": home, "XDG_CONFIG_HOME": home, "XDG_RUNTIME_DIR": home}
        folders["MESA_SHADER_CACHE_DIR"] = os.path.join(home, "mesa")
        environment = {**os.environ, **folders, "DISPLAY": screen.display, "GLINT_EVENT_LOG": self.log, **environment}
        self.events, self.read = [], 0
        self.began = time.time()
        self.process = subprocess.Popen([program, scene], env=environment, stderr=subprocess.DEVNULL)

    def look(self):
        if not os.path.exists(self.log):
            return
        with open(self.log) as log:
            log.seek(self.read)
            for line in iter(log.readline, ""):
                if not line.endswith("\n"):
                    break
                self.read += len(line)
                self.events.append((time.time(), json.loads(line)))

    def settle(self, first=0):
        """Waits until the picture is final after all that moves. Returns when the event came that says so."""
        until = time.time() + PATIENCE
        while time.time() < until:
            self.look()
            final = None
            for at, event in self.events[first:]:
                if event["event"] == "settled":
                    final = at
                elif event["event"] == "frame" and event["moving"]:
                    final = None
            if final:
                return final
            time.sleep(0.01)
        sys.exit(f"no final picture within {PATIENCE} s")

    def frames(self, first=0):
        return [(at, event) for at, event in self.events[first:] if event["event"] == "frame"]

    def end(self):
        self.process.terminate()
        self.process.wait()


def median(values, digits):
    values = [value for value in values if value is not None]
    return f"{statistics.median(values):.{digits}f}" if values else "-"


def starts(program, scene, times):
    """Opens the scene with empty caches, and again. Returns the seconds to the first and the final picture of both."""
    seconds = [[], [], [], []]
    for _ in range(times):
        with tempfile.TemporaryDirectory() as home:
            for again in (0, 2):
                screen = Screen()
                glint = Glint(screen, program, scene, home)
                final = glint.settle()
                seconds[again].append(glint.frames()[0][0] - glint.began)
                seconds[again + 1].append(final - glint.began)
                # What the program keeps for later is written.
                time.sleep(3.0)
                glint.end()
                screen.end()
    return seconds


def drags(program, scene, seconds, times):
    """Drags the scene, and once more for its FLIP. Prints a line."""
    rates, lasted, ages, longest, releases, last, flips = [], [], [], [], [], None, []
    with tempfile.TemporaryDirectory() as home:
        for turn in range(times + 1):
            is_judged = turn == times
            screen = Screen()
            glint = Glint(screen, program, scene, home, **({"GLINT_EVENT_FLIP": "1"} if is_judged else {}))
            glint.settle()
            screen.enlarge(glint.process)
            time.sleep(4.0)
            glint.settle()
            first = len(glint.events)
            released = screen.drag(seconds)
            final = glint.settle(first)
            moving = [event for _, event in glint.frames(first) if event["moving"]]
            if is_judged:
                flips = [event["flip"] for event in moving]
            elif moving:
                last = moving[len(moving) // 2]
                rates.append(len(moving) / seconds)
                lasted.append(statistics.median(event["ms"] for event in moving))
                longest.append(max(event["ms"] for event in moving))
                ages.append(statistics.median(event["since_input_ms"] or 0.0 for event in moving))
                releases.append(final - released)
            glint.end()
            screen.end()
    detail = "{}x{} pixels, {} points".format(*last["size"], last["points"]) if last else "no moving picture"
    print(f"  drag: {median(rates, 1)} pictures a second of {detail}; {median(lasted, 0)} ms each, at most")
    print(f"        {median(longest, 0)}; input {median(ages, 0)} ms old; FLIP to rest {median(flips, 3)};")
    print(f"        release to final {median(releases, 2)} s", flush=True)


def answer(screen, began):
    """Accepts what a program proposes that asks how to read a file, once it asks. Returns the seconds until then."""
    while time.time() - began < 10.0:
        questions = screen.xdotool("search", "--onlyvisible", "--name", "File Open|Open LAS")
        if questions:
            screen.xdotool("windowfocus", questions[-1], "key", "Return")
            return time.time() - began
        time.sleep(0.02)
    return None


def outside(name, command, seconds, asks):
    """Opens a program twice, drags, and prints what a recorder of the screen counts."""
    openings, waits = [], []
    with tempfile.TemporaryDirectory() as home:
        for again in (False, True):
            screen = Screen()
            environment = {**os.environ, "DISPLAY": screen.display, "HOME": home, "XDG_RUNTIME_DIR": home}
            recording = screen.record(20)
            began = time.time()
            process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            waits.append(answer(screen, began) if asks else None)
            opened = changes(recording)
            openings.append(opened[-1] - began if opened else float("nan"))
            if again:
                screen.enlarge(process)
                time.sleep(4.0)
                recording = screen.record(seconds + 8)
                time.sleep(0.5)
                released = screen.drag(seconds)
                seen = changes(recording)
            process.terminate()
            process.wait()
            screen.end()
    rate = sum(released - seconds < at < released for at in seen) / seconds
    first = next((at - released + seconds for at in seen if at > released - seconds), float("nan"))
    final = max([at - released for at in seen if at > released], default=0.0)
    print(f"  {name} from outside: {rate:.1f} changes a second, the first {first:.2f} s after the drag began;")
    print(f"        release to last change {final:.2f} s; start to last change {openings[0]:.1f} s, again {openings[1]:.1f}", end="")
    print(f" ({waits[1]:.1f} of them until a question was answered)" if waits[1] else "", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/glint")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("inputs", nargs="+")
    asked = parser.parse_args()
    program = os.path.abspath(asked.program)
    missing = [tool for tool in (program, "Xvfb", "xdotool") if not shutil.which(tool)]
    if missing:
        sys.exit(f"not found: {', '.join(missing)}")
    other = shutil.which("CloudCompare") or shutil.which("cloudcompare.CloudCompare")
    if not other:
        print("CloudCompare is not installed: glint is measured alone.")
    elif not shutil.which("ffmpeg"):
        sys.exit("not found: ffmpeg, which counts the pictures of CloudCompare")
    for scene in asked.inputs:
        print(f"{scene}, {SIZE[0]}x{SIZE[1]}, load {os.getloadavg()[0]:.1f}", flush=True)
        first, final, later, later_final = starts(program, scene, asked.times)
        print(f"  first start: first picture {median(first, 1)} s, final {median(final, 1)} s; later starts:")
        print(f"        {median(later, 1)} and {median(later_final, 1)} s", flush=True)
        drags(program, scene, asked.seconds, asked.times)
        if other and os.path.exists(scene):
            outside("CloudCompare", [other, os.path.abspath(scene)], asked.seconds, True)
            outside("glint", [program, os.path.abspath(scene)], asked.seconds, False)


if __name__ == "__main__":
    main()
