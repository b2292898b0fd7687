"""passloc environments: an observer manoeuvres to localise a moving emitter that it can only hear.

Importing this package registers the Gymnasium ids ``passloc/…-v0``. Its names, listed in the stub beside this file, are
imported when they are first used, so that a command which only lists scenarios does not wait for Gymnasium.
"""

import lazy_loader

from passloc_env.registration import register_with_gymnasium
from passloc_env.shadowing import warn_if_shadowed

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"

register_with_gymnasium()
warn_if_shadowed()
