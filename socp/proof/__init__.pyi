from .balls import flint as flint
from .bound.bounding import lower_bound as lower_bound
from .bound.checking import checked as checked
from .bound.told import LowerBound as LowerBound
from .proving import BITS as BITS
from .proving import Existence as Existence
from .proving import prove as prove
