"""Training networks: epochs that log, checkpoint and resume, in one process or several."""

from nvsdata.training.data import Halves, data_of, loader
from nvsdata.training.evaluation import accuracies, outputs
from nvsdata.training.main import run
from nvsdata.training.optimizers import adam, sgd
from nvsdata.training.processes import Team, team
from nvsdata.training.trainer import Trainer

__all__ = ["Halves", "Team", "Trainer", "accuracies", "adam", "data_of", "loader", "outputs", "run", "sgd", "team"]
