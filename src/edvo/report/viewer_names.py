"""Names of what is logged for the viewer: timelines and entities."""

TIME = "time"  # since the first frame
FRAME = "frame"

WORLD = "world"
MAP = f"{WORLD}/edges"
PATH = f"{WORLD}/path"
TRUTH = f"{WORLD}/truth"
KEYFRAMES = f"{WORLD}/keyframes"
CAMERA = f"{WORLD}/camera"

IMAGE = f"{CAMERA}/image"
EDGES = f"{IMAGE}/edges"
SAMPLES = f"{IMAGE}/samples"
MATCHES = f"{IMAGE}/matches"
DEPTH = f"{CAMERA}/depth"

ERROR = "plots/error"
FIT = "plots/fit"
ITERATIONS = "plots/iterations"
TIMES = "plots/time"

STATE = "status/state"
LOG = "status/log"
