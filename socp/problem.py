"""The problem language under the address that files of version 0.1 import it from; new files import from `socp`."""

from socp import (
    Problem as Problem,
)
from socp import (
    Reference as Reference,
)
from socp import (
    Scene as Scene,
)
from socp import (
    controls as controls,
)
from socp import (
    final_time as final_time,
)
from socp import (
    free as free,
)
from socp import (
    initial as initial,
)
from socp import (
    initial_time as initial_time,
)
from socp import (
    parameters as parameters,
)
from socp import (
    states as states,
)
from socp import (
    time as time,
)
