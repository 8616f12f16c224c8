"""Published accuracies on JIGSAWS: each figure, what the text that could be read says of it, and what it leaves open.

Only abstracts and opening pages could be read, in the copies that `Published.read` names; what stands further on in a
paper may close what is listed as open. The venues are quoted from other lists, not from these copies.
"""

from dataclasses import dataclass
from typing import Final

from tis.deploy.studies.definitions.readings import ERRORS, HORIZONS_S, SPANS, SPLITS, Error, Span, Split


@dataclass(frozen=True)
class Published:
    """A published figure.

    ``errors``, ``spans`` and ``splits`` are the readings that the text allows; ``differs`` holds the reasons why it
    is not comparable under any of them. ``mm`` is None for a figure that is no distance.
    """

    name: str
    citation: str
    read: str
    figure: str
    mm: float | None
    horizon_s: float | None
    says: str
    leaves_open: tuple[str, ...]
    differs: tuple[str, ...] = ()
    errors: tuple[Error, ...] = ERRORS
    spans: tuple[Span, ...] = SPANS
    splits: tuple[Split, ...] = SPLITS

    def __post_init__(self) -> None:
        assert self.mm is None or self.horizon_s in HORIZONS_S


_OPEN: Final = (
    "which error (RMSE or mean, 3D or of an axis)",
    "at the horizon or over all steps up to it",
    "samples per second",
)
_SHI: Final = (
    "C. Shi, Y. Zheng, A. Majewicz Fey: Recognition and Prediction of Surgical Gestures and Trajectories Using "
    "Transformer Models in Robot-Assisted Surgery. IROS 2022, arXiv:2212.01683"
)
_QIN: Final = (
    "Y. Qin, S. Feyzabadi, M. Allan, J. W. Burdick, M. Azizian: daVinciNet: Joint Prediction of Motion and Surgical "
    "State in Robot-Assisted Surgery. IROS 2020, arXiv:2009.11937"
)
_QIN_SAYS: Final = (
    '"up to"; inputs are kinematics, endoscopic video and system events; evaluated on RIOUS+ (ultrasound imaging) '
    "and JIGSAWS"
)
_QIN_OPEN: Final = (*_OPEN, "which of the two data sets the figure is of", "split", "whether velocities are inputs")
_QIN_READ: Final = "abstract, in the copy of arxiv-vanity.com"
_QIN_DIFFERS: Final = ("it also sees video and events",)

PUBLISHED: Final = (
    Published(
        name="Shi 2022",
        citation=_SHI,
        read="abstract and first lines of the introduction, in the copy of ar5iv.labs.arxiv.org",
        figure="2.71 mm at 1 s",
        mm=2.71,
        horizon_s=1.0,
        says='"up to"; "trajectory prediction error (1 second ahead)"; JIGSAWS; one user out; inputs are '
        "kinematics of the end effectors only",
        leaves_open=(*_OPEN, "whether velocities are inputs", "tasks and arms"),
        splits=("user",),
    ),
    Published(
        name="daVinciNet, short",
        citation=_QIN,
        read=_QIN_READ,
        figure="1.07 mm at 0.5 s",
        mm=1.07,
        horizon_s=0.5,
        says=_QIN_SAYS,
        leaves_open=_QIN_OPEN,
        differs=_QIN_DIFFERS,
    ),
    Published(
        name="daVinciNet, long",
        citation=_QIN,
        read=_QIN_READ,
        figure="5.62 mm at 2 s",
        mm=5.62,
        horizon_s=2.0,
        says=_QIN_SAYS,
        leaves_open=_QIN_OPEN,
        differs=_QIN_DIFFERS,
    ),
    Published(
        name="Weerasinghe 2024",
        citation="K. Weerasinghe, S. H. R. Roodabeh, K. Hutchinson, H. Alemzadeh: Multimodal Transformers for "
        "Real-Time Surgical Activity Prediction. ICRA 2024, arXiv:2403.06705",
        read="abstract in the copy of arxiv.org, and config.py, datagen.py and train_prediction.py of its code, "
        "UVA-DSA/MTRSAP",
        figure="errors of an axis",
        mm=None,
        horizon_s=None,
        says="30 rows in, 10 out, 30 rows a second; one user out; RMSE and MAE of x, y and z of each arm over all "
        "steps of all windows; inputs are kinematics (with velocities), video and context",
        leaves_open=("the figures themselves, which stand in a table that was not read", "trials"),
        differs=("its figures were not read; ours by its definitions are the table *30 rows in, 10 out*",),
    ),
    Published(
        name="Informer 2025",
        citation="A Predictive Approach for Enhancing Accuracy in Remote Robotic Surgery Using Informer Model. "
        "Sensors 25 (10), 3067, 2025",
        read="abstract, in the copy of aimedicalcompendium.com, and the reviewers' reports at mdpi.com",
        figure="over 90 %",
        mm=None,
        horizon_s=None,
        says='"prediction accuracy of over 90 percent under various network scenarios"; JIGSAWS; packets are lost '
        "by a Markov chain of four states",
        leaves_open=("what 100 % is", "horizon", "split", "inputs"),
        differs=("it is no distance, and the abstract does not define it",),
    ),
)
