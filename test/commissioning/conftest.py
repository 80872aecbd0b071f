"""The machines of these tests are importable as a user's backend would be."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
