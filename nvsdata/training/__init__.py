"""Training networks: epochs that log, checkpoint and resume, in one process or several."""

from nvsdata.training.data import TrainTestSplit, data_of, loader
from nvsdata.training.evaluation import accuracies, predict
from nvsdata.training.main import run
from nvsdata.training.optimizers import adam, sgd
from nvsdata.training.processes import Team, team
from nvsdata.training.trainer import Trainer

__all__ = [
    "Team",
    "TrainTestSplit",
    "Trainer",
    "accuracies",
    "adam",
    "data_of",
    "loader",
    "predict",
    "run",
    "sgd",
    "team",
]
