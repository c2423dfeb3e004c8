"""The add-on inside Blender: pictures through the engine against closed forms, and against Cycles where both show the same.

Runs under a Python that has `bpy`, or as a script of Blender; `tests/blender.sh` finds one, and the program. Arguments are names of tests, as
`Lights.test_sun`.
"""

import os
import sys
import unittest
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

import blender

blender.register()

from inside_camera import *
from inside_engine import *
from inside_light import *
from inside_surfaces import *
from stage import FOLDER

if __name__ == "__main__":
    # `blender --background --python FILE -- ARGUMENTS` keeps its own arguments.
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ([] if bpy.app.binary_path else sys.argv[1:])
    done = unittest.main(argv=["in_blender.py"] + own, exit=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender.unregister()
    FOLDER.cleanup()
    sys.stdout.flush()
    os._exit(0 if done.result.wasSuccessful() else 1)
