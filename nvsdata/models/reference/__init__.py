"""Baseline networks with which the thesis compares its own (sections 4.4.4 and 3.5, appendices A and B)."""

from nvsdata.models.reference.c3d import C3D, MotionVector3D
from nvsdata.models.reference.inception import I3D, InceptionV4
from nvsdata.models.reference.p3d import P3D
from nvsdata.models.reference.points import LSTM, PointNet, PointNet2
from nvsdata.models.reference.resnet import R2Plus1D, ResNet, ResNet3D, ResNeXt3D
from nvsdata.models.reference.vgg import VGG

__all__ = [
    "C3D",
    "I3D",
    "LSTM",
    "P3D",
    "VGG",
    "InceptionV4",
    "MotionVector3D",
    "PointNet",
    "PointNet2",
    "R2Plus1D",
    "ResNeXt3D",
    "ResNet",
    "ResNet3D",
]
