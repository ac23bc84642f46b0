"""Write the stored trajectories anew, where a change of the tracker is meant to change them.

python -m tests.golden.make
"""

from tests.test_golden import stored, tracked

from edvo.config import PRESETS

if __name__ == "__main__":
    for preset in PRESETS:
        tracked(preset).write(stored(preset))
