from .balls import flint as flint
from .proving import BITS as BITS
from .proving import Existence as Existence
from .proving import prove as prove
