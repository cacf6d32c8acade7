"""Training of networks with logs, checkpoints and resumption, in one process or several."""

from nvsdata.training.data import TrainTestSplit, data_of, loader
from nvsdata.training.evaluation import Votes, cost, predict, predict_batches, votes, window_ms
from nvsdata.training.negatives import Negatives
from nvsdata.training.optimizers import adam, sgd
from nvsdata.training.processes import Team, team
from nvsdata.training.report import write_report
from nvsdata.training.runs import run, to_tensorboard
from nvsdata.training.trainer import Trainer

__all__ = [
    "Negatives",
    "Team",
    "TrainTestSplit",
    "Trainer",
    "Votes",
    "adam",
    "cost",
    "data_of",
    "loader",
    "predict",
    "predict_batches",
    "run",
    "sgd",
    "team",
    "to_tensorboard",
    "votes",
    "window_ms",
    "write_report",
]
