"""What Python imports first in processes that tests start."""

from changed import change_modules

change_modules()
