"""The program `cardioid` as a process: its command line, its progress, its messages."""

import json
import os
import re
import shlex
import shutil
import subprocess
import threading
import time

#: Rounds of each preset in progressive rendering (docs/settings.md).
ROUNDS = {"draft": 4, "preview": 16, "final": 128, "reference": 2048}


class ProgramError(Exception):
    """What went wrong, for the user."""


def find(preference):
    """The path of the program: that of the preferences, or else that on PATH."""
    if preference:
        path = os.path.expanduser(preference)
        if os.path.isdir(path):
            path = os.path.join(path, "cardioid")
        if not os.path.isfile(path):
            raise ProgramError(f"there is no program {path}; correct its path in the preferences of the add-on cardioid")
        if not os.access(path, os.X_OK):
            raise ProgramError(f"{path} is no program that can be run; correct its path in the preferences of the add-on cardioid")
        return path
    found = shutil.which("cardioid")
    if not found:
        raise ProgramError(
            "the program cardioid is not on PATH; install it (`cargo install --locked --path .` in its folder), or give its path in "
            "the preferences of the add-on cardioid"
        )
    return found


def options(quality, integrator, seed, time_limit=0.0, threads=0, extra="", rounds=0):
    """Options of `cardioid render`. 0 leaves a number to the program."""
    words = ["--quality", quality, "--integrator", integrator, "--seed", str(seed)]
    if integrator == "progressive" and rounds:
        words += ["--rounds", str(rounds)]
    if time_limit > 0.0:
        words += ["--time-limit", f"{time_limit:.3f}s"]
    if threads:
        words += ["--threads", str(threads)]
    try:
        return words + shlex.split(extra)
    except ValueError as error:
        raise ProgramError(f"the extra arguments cannot be read: {error}") from error


def command(program, scene, picture, words, window=None):
    """The whole command line. `window`: pixels to render, from the top left."""
    line = [program, "render", scene, "-o", picture, "--overwrite", "--progress", "json", "--end-with-input"]
    if window:
        line += ["--crop", ",".join(str(number) for number in window)]
    return line + list(words)


def round_steps(rounds):
    """After how many rounds a picture is shown: powers of two, and the last."""
    steps, step = [], 1
    while step < rounds:
        steps.append(step)
        step *= 2
    return steps + [rounds]


class Run:
    """A process that renders. `poll` tells how far it is; `cancel` ends it."""

    def __init__(self, line, folder=None):
        # A group of its own, so that Ctrl-C in a terminal of Blender reaches Blender alone.
        try:
            self._process = subprocess.Popen(
                line,
                cwd=folder,
                # The program ends with its input, so that none outlives Blender.
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise ProgramError(f"{line[0]} cannot be started: {error.strerror}") from error
        self.step, self.share = "starting", 0.0
        self.messages = []
        self._threads = [
            threading.Thread(target=self._follow, args=(stream, take), daemon=True)
            for stream, take in ((self._process.stdout, self._take_progress), (self._process.stderr, self.messages.append))
        ]
        for thread in self._threads:
            thread.start()

    @staticmethod
    def _follow(stream, take):
        with stream:
            for line in stream:
                take(line.decode(errors="replace").rstrip("\n"))

    def _take_progress(self, line):
        try:
            told = json.loads(line)
            step, total = told["step"], told.get("total")
            share = told["done"] / total if total else 0.0
        except (ValueError, KeyError, TypeError):
            return
        self.step, self.share = step, share

    def poll(self):
        """The exit code once the process has ended and all that it wrote is read; None before."""
        code = self._process.poll()
        if code is not None:
            self._end()
        return code

    def _end(self):
        self._process.stdin.close()
        for thread in self._threads:
            thread.join()

    def cancel(self, patience=3.0):
        """Asks it to stop, and ends it where it takes longer than `patience` seconds."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(patience)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._end()

    def failure(self, code):
        """The program's own message of why it failed."""
        text = [line for line in self.messages if line.strip()]
        first = next((i for i, line in enumerate(text) if line.startswith("error")), None)
        if first is not None:
            return "\n".join(text[first:])
        if code < 0:
            return f"cardioid was ended by signal {-code}"
        return "\n".join(text[-5:]) or f"cardioid ended with code {code} and without a message"


#: Remedies that are those of the command line and of scene files.
_REMEDIES = (
    (re.compile(r" \(--set .*\)$"), ""),
    (re.compile(r"^(the scene has no light, so the picture is black): .*"), r"\1: add a light, or give the world a colour"),
)


def sorted_messages(lines, scene=""):
    """Messages of a run as pairs of a kind, WARNING or INFO, and a text. Figures of the summary are no messages.

    `scene`: the path of the scene file, which says nothing to the user of Blender.
    """
    found = []
    for line in lines:
        for prefix, kind in (("warning: ", "WARNING"), ("note: ", "INFO")):
            if line.startswith(prefix):
                text = line[len(prefix) :]
                for place in (f"{scene}: model: ", f"{scene}: "):
                    text = text.removeprefix(place) if scene else text
                for remedy, instead in _REMEDIES:
                    text = remedy.sub(instead, text)
                found.append((kind, text))
    return found


def seconds_left(start, limit):
    """Seconds of a time limit that are left; 0 without a limit."""
    return max(limit - (time.monotonic() - start), 0.001) if limit > 0.0 else 0.0
