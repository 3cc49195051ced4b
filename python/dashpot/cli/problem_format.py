"""What a problem file looks like, apart from what reads it: help needs no calibration loaded."""

from __future__ import annotations

FORMAT = """\
Problem file, TOML shown, JSON with the same keys; paths are relative to the file:

model = "scene.xml"              # MJCF, URDF or MJB
position_sigma = 0.001           # m, standard deviation of an observed coordinate, or three, of
rotation_sigma = 0.01            #   x, y, z; rad; inf (JSON: Infinity), or none: not measured
noise = "stated"                 # or "estimate": they are where the estimation of noise starts
initial_state = "pose_and_velocity"   # estimated; or "velocity", "given"; optional, as are
substeps = 4                     #   steps per frame, and
window = 0.5                     #   seconds of each trajectory that are used

[sensor_sigma]                   # standard deviations of sensors of the model, in their units;
# encoder = 1e-4                 #   optional; pixels: of all points in pixels

[materials.ball]                 # starting materials, fields of dashpot.Material; optional
stiffness = 1e4
restitution = 0.6

[[parameters]]                   # unknowns
kind = "material"                # of geoms; "pair": of two geoms with each other, or of several
geoms = ["ball"]                 #   twos, [["left", "cube"], ["right", "cube"]]; "model":
quantity = "stiffness"           #   attribute, elements, index of the MuJoCo model; "inertia":
start = 1e4                      #   body, and optional mass = [LOWER, UPPER], centre, shape;
bounds = [1e2, 1e6]              #   lists of numbers and of bounds make a vector;
                                 #   "delay", "gain", "offset": channel; "scale": of positions;
                                 #   "image": quantity, camera
# frozen = true                  # held at its start
# per = "trajectory"             # one value for each; or a table of names of trajectories by group

[[trajectories]]                 # observations
file = "throw.npz"               # arrays time, position, quaternion, and if known
bodies = ["ball"]                #   initial_qpos, initial_qvel (and with _sigma how well),
                                 #   control, sensors.NAME; or a .csv file with columns time,
                                 #   x,y,z,qw,qx,qy,qz (ball.x, ... for several), sensors.NAME
                                 #   (sensors.NAME.0, .1 ... for several); nan or an empty cell:
                                 #   not measured in that frame; without bodies sensors alone;
                                 #   u,v (ball.u, ...; .npz: pixels.ball): in pixels of a
# camera = "side"                #   camera of the model, or a picture: {scale = 812, origin =
                                 #   [320, 240], right = [1, 0, 0], down = [0, 0, -1]}
# columns = {time = "t", z = "height", "sensor:load" = "F"}   # names of a .csv file's columns,
# unit = {time = "ms", z = "cm"}                              #   and their units; optional, as is
# frames = "even"                #   "stamped" (default): times are right; "even": stamps jitter

[fit]                            # options of dashpot.calibrate.fit; optional
method = "least_squares"
starts = 16
"""
"""What a problem file looks like, as the command's help says it."""
