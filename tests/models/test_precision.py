from copy import deepcopy

import pytest
import torch
from graphs import random_batch

from nvsdata import models
from nvsdata.models.spline import SplineConv
