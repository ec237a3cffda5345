"""socp: singular optimal control problems, from one file to arcs, switching times and a verdict.

The names below are the public language. They are loaded on first use, so that `import socp` costs
nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
