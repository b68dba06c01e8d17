"""The catalogue of issue codes: what each means, kept as data and rendered into SPEC.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from pliant.spec.errors import Issue, Severity
from pliant.spec.text import escaped

Subject = Literal["both", "dataset", "submission"]


@dataclass(frozen=True)
class IssueCode:
    """One kind of problem.

    Attributes:
        code: Stable name; a published code never changes its meaning.
        severity: `error` makes the data invalid; `warning` does not.
        subject: Whether the code can be reported of a dataset, of a submission, or of both.
        meaning: When it is reported, in one sentence.
    """

    code: str
    severity: Severity
    subject: Subject
    meaning: str


def _catalogue(*codes: IssueCode) -> dict[str, IssueCode]:
    return {code.code: code for code in codes}


ISSUE_CODES: Final[dict[str, IssueCode]] = _catalogue(
    # Files
    IssueCode("FILE_MISSING", "error", "both", "A required file or folder is not there."),
    IssueCode(
        "FILE_EXTRA", "error", "dataset", "A file or folder that the layout does not provide for."
    ),
    IssueCode(
        "FILE_UNREADABLE",
        "error",
        "both",
        "A file cannot be decoded: truncated, damaged, or of another kind than its name says.",
    ),
    IssueCode(
        "FILE_TOO_LARGE",
        "error",
        "both",
        "A file, or what its header announces, passes a limit of the specification.",
    ),
    IssueCode(
        "PATH_UNSAFE",
        "error",
        "dataset",
        "A path is absolute, holds `..`, is a link or a special file, or leaves the dataset.",
    ),
    IssueCode(
        "CHECKSUM_DIFFERS",
        "error",
        "dataset",
        "A file's size or sha256 differs from what its sequence.json, or SHA256SUMS, lists.",
    ),
    IssueCode(
        "FILE_UNLISTED",
        "error",
        "dataset",
        "The list of files in sequence.json leaves a file of the sequence out, or repeats one; or "
        "SHA256SUMS leaves one out.",
    ),
    IssueCode(
        "INDEX_INVALID",
        "error",
        "dataset",
        "The index of a packed dataset lists other sequences than sequences.parquet, or a place "
        "that no shard has.",
    ),
    # Documents
    IssueCode(
        "SPEC_VERSION_UNSUPPORTED",
        "error",
        "both",
        "The file's spec_version is of another major version than the reader knows.",
    ),
    IssueCode(
        "SPEC_VERSION_NEWER",
        "warning",
        "dataset",
        "The dataset's minor version is newer than the validator; unknown fields were skipped.",
    ),
    IssueCode("SCHEMA_INVALID", "error", "dataset", "A JSON file breaks its JSON Schema."),
    IssueCode(
        "IDENTITY_DIFFERS",
        "error",
        "dataset",
        "Two places that name the same thing disagree: folder, sequence.json, sequences.parquet, "
        "cameras.json or a footer.",
    ),
    IssueCode(
        "TIER_INVALID",
        "error",
        "dataset",
        "A tier repeats a name or an object id, or its queried object is none of its objects.",
    ),
    IssueCode("TIER_UNKNOWN", "error", "dataset", "A tier that dataset.json does not declare."),
    IssueCode("SPLIT_UNKNOWN", "error", "dataset", "A split that dataset.json does not declare."),
    IssueCode(
        "SPLIT_SHARED",
        "error",
        "dataset",
        "A sequence, or a frame by its decoded content, is in two splits.",
    ),
    IssueCode(
        "FRAME_REPEATED",
        "warning",
        "dataset",
        "Two frames of one split have the same content, and are not of one episode.",
    ),
    IssueCode(
        "SYMMETRY_INVALID",
        "error",
        "dataset",
        "A symmetry is no bijection of the queried object's material, or is the identity.",
    ),
    IssueCode(
        "HELD_OUT_LEAKS",
        "error",
        "dataset",
        "A held-out split comes with its truth, or with what gives it away.",
    ),
    # Tables
    IssueCode("FOOTER_MISSING", "error", "both", "A Parquet file has no `pliant` footer object."),
    IssueCode("FOOTER_INVALID", "error", "both", "The footer object breaks its JSON Schema."),
    IssueCode("COLUMN_MISSING", "error", "both", "A required column is not there."),
    IssueCode("COLUMN_TYPE", "error", "both", "A column has another type than the specification."),
    IssueCode(
        "COLUMN_EXTRA",
        "error",
        "dataset",
        "A column the specification does not know, or one name twice.",
    ),
    IssueCode("ROW_MISSING", "error", "both", "A row that must be there is not."),
    IssueCode("ROW_DUPLICATE", "error", "both", "Two rows with one key."),
    IssueCode("ROW_UNKNOWN", "error", "both", "A row whose key belongs to nothing in the dataset."),
    IssueCode("ROW_ORDER", "error", "dataset", "Rows are not in the required order."),
    IssueCode("VALUE_NULL", "error", "both", "A null where none is allowed."),
    IssueCode("VALUE_NOT_FINITE", "error", "both", "NaN or infinity where none is allowed."),
    IssueCode("VALUE_OUT_OF_RANGE", "error", "both", "A value outside its range."),
    # Images
    IssueCode(
        "IMAGE_FORMAT",
        "error",
        "dataset",
        "An image of another kind: bit depth, channels, pixel types, compression or parts.",
    ),
    IssueCode(
        "IMAGE_SIZE_DIFFERS", "error", "dataset", "An image's size is not that of dataset.json."
    ),
    IssueCode(
        "DEPTH_INVALID",
        "error",
        "dataset",
        "Z is NaN or not positive, or is not +inf exactly where the object id is 0.",
    ),
    IssueCode(
        "SURFACE_INVALID",
        "error",
        "dataset",
        "The surface layer holds an unknown object id, or a material coordinate outside its "
        "object's range.",
    ),
    # Geometry
    IssueCode(
        "CAMERA_INVALID",
        "error",
        "dataset",
        "K or the pose is no camera: no rotation, a focal length not positive, a bad last row.",
    ),
    IssueCode(
        "REPROJECTION_DISAGREES",
        "error",
        "dataset",
        "A point's u_px, v_px are not the projection of its world position.",
    ),
    IssueCode(
        "DEPTH_DISAGREES",
        "error",
        "dataset",
        "A point's depth_m is not the camera-space z of its world position.",
    ),
    IssueCode(
        "OUT_OF_FRAME_DISAGREES",
        "error",
        "dataset",
        "A point is out_of_frame though it projects into the image, or the reverse.",
    ),
    IssueCode(
        "VISIBLE_DISAGREES",
        "error",
        "dataset",
        "A visible point is not on the surface that the depth image shows around its pixel.",
    ),
    IssueCode(
        "OCCLUDED_DISAGREES",
        "error",
        "dataset",
        "A hidden point is nearer than everything at its pixel, or is hidden by another object "
        "than its state says.",
    ),
    IssueCode(
        "MATERIAL_DISAGREES",
        "error",
        "dataset",
        "The material coordinate of a visible point is not that of the surface at its pixel.",
    ),
    IssueCode(
        "OFFSET_DISAGREES",
        "error",
        "dataset",
        "The points of a sequence or frame are a constant shift away from where the surface layer "
        "shows their material.",
    ),
    IssueCode(
        "OFFSET_SCATTERS",
        "warning",
        "dataset",
        "The points of a sequence are scattered around where the surface layer shows their "
        "material.",
    ),
    IssueCode(
        "DEPTH_IMAGE_DISAGREES",
        "error",
        "dataset",
        "The depth images of a sequence show other depths than its points have.",
    ),
    IssueCode(
        "DEPTH_IMAGE_SCATTERS",
        "warning",
        "dataset",
        "The depth images of a sequence are noisy against its points.",
    ),
    IssueCode(
        "PRECISION_LOST",
        "error",
        "dataset",
        "The values of an image went through a coarser format: float16, 8 bits, whole millimetres.",
    ),
    IssueCode(
        "SCALE_DISAGREES",
        "error",
        "dataset",
        "metres_per_unit differs from the size that the images show by a factor of 3 or more.",
    ),
    IssueCode(
        "COLOUR_DISAGREES",
        "error",
        "dataset",
        "Colour images are shifted, turned, blank, or of other frames than the surface images.",
    ),
    IssueCode(
        "COLOUR_DOUBTFUL",
        "warning",
        "dataset",
        "Colour images do not show the objects' silhouettes, or may be wrong for a reason that "
        "noise or foreign pictures can also have.",
    ),
    IssueCode(
        "PARTNER_DISAGREES",
        "error",
        "dataset",
        "A point's partner is not the point that the tier's symmetry maps it to.",
    ),
    IssueCode(
        "POINTS_DIFFER",
        "error",
        "dataset",
        "The point table of a sequence differs from that of the other sequences of its tier.",
    ),
    IssueCode(
        "SUMMARY_DISAGREES",
        "error",
        "dataset",
        "self_occluded in sequences.parquet does not follow from the correspondences.",
    ),
    # Queries and truth
    IssueCode(
        "QUERY_INVALID",
        "error",
        "dataset",
        "A query names an unknown sequence or frame, or one of another tier or split.",
    ),
    IssueCode(
        "QUERY_NOT_VISIBLE",
        "error",
        "dataset",
        "A query does not lie on visible surface of the queried object.",
    ),
    IssueCode(
        "TRUTH_DISAGREES",
        "error",
        "dataset",
        "An answer of the truth does not follow from the tables of its sequences.",
    ),
    # Submissions
    IssueCode(
        "DATASET_MISMATCH", "error", "submission", "The footer names another dataset or version."
    ),
    IssueCode("SPLIT_MISMATCH", "error", "submission", "The footer names another split."),
    IssueCode(
        "QUERIES_MISMATCH",
        "error",
        "both",
        "The footer's queries_sha256 is not that of the split's queries file.",
    ),
    IssueCode(
        "MODES_INVALID",
        "error",
        "submission",
        "The modes of a row are empty, their weights do not sum to 1 within 1e-3, or there is a "
        "column sigma beside them.",
    ),
)
"""Every issue code by its name."""


def make_issue(code: str, path: str, where: str, message: str) -> Issue:
    """Return an issue with the severity of its code; unsafe characters are escaped.

    Args:
        code: A key of `ISSUE_CODES`.
        path: File, relative to the dataset (or the submission's own path).
        where: Field, row, frame or query inside the file; empty for the whole file.
        message: Found, required and what to do, in words.
    """
    return Issue(code, ISSUE_CODES[code].severity, escaped(path), escaped(where), escaped(message))
