"""The usual cause of every issue code, and its remedy; `docs/errors.md` shows them as tables."""

from __future__ import annotations

from typing import Final

REMEDIES: Final[dict[str, tuple[str, str]]] = {
    "FILE_MISSING": ("Incomplete copy or download.", "Copy or generate the dataset again."),
    "FILE_EXTRA": ("Notes or exports in the folder.", "Move the file out of the dataset."),
    "FILE_UNREADABLE": ("Truncated copy, or a wrong suffix.", "Copy or write the file again."),
    "FILE_TOO_LARGE": (
        "A limit is exceeded, or the header is damaged.",
        "Divide the sequence or shard, or write the file again.",
    ),
    "PATH_UNSAFE": (
        "Links, as the Hub's download cache has.",
        "Copy real files: `snapshot_download(…, local_dir=…)`.",
    ),
    "CHECKSUM_DIFFERS": (
        "The file was edited or damaged after its checksum was written.",
        "Restore the file, or write the list of checksums again.",
    ),
    "FILE_UNLISTED": (
        "A file was added, or listed twice.",
        "List each file once in `files` (or `SHA256SUMS`), or remove it.",
    ),
    "INDEX_INVALID": ("Shards and index are of different runs.", "Publish the dataset again."),
    "SPEC_VERSION_UNSUPPORTED": (
        "The file is of another major version.",
        "Install a version of Pliant that reads it; see `pliant migrate`.",
    ),
    "SPEC_VERSION_NEWER": ("Pliant is older than the dataset.", "Update Pliant."),
    "SCHEMA_INVALID": (
        "A misspelt, missing or wrongly typed field.",
        "Correct the field that the message names; `pliant spec dataset` prints the schema.",
    ),
    "IDENTITY_DIFFERS": (
        "A folder or file was renamed or copied.",
        "Give folder, sequence.json, sequences.parquet and footers the same name.",
    ),
    "TIER_INVALID": ("An object id or name is repeated.", "Correct `tiers` of dataset.json."),
    "TIER_UNKNOWN": ("A tier is misspelt or not declared.", "Declare it in dataset.json."),
    "SPLIT_UNKNOWN": ("A split is not declared.", "Add it to `splits` of dataset.json."),
    "SPLIT_SHARED": (
        "A sequence was copied, or frames were divided at random.",
        "Keep each sequence in one split.",
    ),
    "FRAME_REPEATED": ("The same frame was rendered twice.", "Remove one, if it is not intended."),
    "SYMMETRY_INVALID": (
        "A wrong matrix or offset, or symmetries that do not form a group.",
        "List every symmetry of the group except the identity.",
    ),
    "HELD_OUT_LEAKS": (
        "Truth, depth or a seed of a held-out split was copied.",
        "Publish with `pliant publish --hold-out`.",
    ),
    "FOOTER_MISSING": (
        "Written by pandas, which drops the metadata.",
        "Write with pyarrow, or start from `pliant submit-template`.",
    ),
    "FOOTER_INVALID": (
        "A missing or misspelt field in the footer.",
        "Correct it; `pliant spec footer-answers` prints the schema.",
    ),
    "COLUMN_MISSING": ("A column has another name.", "Rename or add the column."),
    "COLUMN_TYPE": (
        "Integers or float16 for positions, or float64 in a dataset.",
        "Cast the column to the type in the message.",
    ),
    "COLUMN_EXTRA": ("An index column of pandas.", "Drop the column (`index=False`)."),
    "ROW_MISSING": (
        "The method skipped queries.",
        "Answer every query, or evaluate with `--allow-missing`.",
    ),
    "ROW_DUPLICATE": ("Results were concatenated twice.", "Keep one row per key."),
    "ROW_UNKNOWN": ("Rows of another split or dataset.", "Remove the rows."),
    "ROW_ORDER": ("The table was shuffled.", "Sort by the key that the message names."),
    "VALUE_NULL": ("A failed computation, or a join without match.", "Fill the value."),
    "VALUE_NOT_FINITE": (
        "NaN of a template or a failed computation.",
        "Write a finite position; report doubt with `visible`.",
    ),
    "VALUE_OUT_OF_RANGE": (
        "Wrong units, or a value outside its range.",
        "Correct it to the range in the message.",
    ),
    "IMAGE_FORMAT": (
        "Another image writer: palette, alpha, 16 bits, RLE or PIZ compression.",
        "Write 8-bit RGB PNG; EXR with NONE, ZIPS or ZIP and the four channels.",
    ),
    "IMAGE_SIZE_DIFFERS": ("Images were resized.", "Render at the size of dataset.json."),
    "DEPTH_INVALID": (
        "Background is 0 or NaN.",
        "Write +inf where the object id is 0, positive depth elsewhere.",
    ),
    "SURFACE_INVALID": (
        "Ids not declared, or interpolated material coordinates.",
        "Sample at pixel centres without interpolation.",
    ),
    "CAMERA_INVALID": (
        "A camera-to-world or non-rigid matrix.",
        "Write a rigid world_to_camera matrix, x right, y down, z forward.",
    ),
    "REPROJECTION_DISAGREES": (
        "Another pixel convention, axes, units or camera.",
        "Project with the formula of the specification; the message names a cause if it fits.",
    ),
    "DEPTH_DISAGREES": ("Length of the ray, or other units.", "Write camera-space z in metres."),
    "OUT_OF_FRAME_DISAGREES": (
        "Off by one at the border.",
        "Use 0 ≤ u < width and 0 ≤ v < height.",
    ),
    "VISIBLE_DISAGREES": (
        "Depth images of another frame or geometry.",
        "Render depth and points from the same mesh.",
    ),
    "OCCLUDED_DISAGREES": (
        "Visibility from a depth buffer, or of another object.",
        "Cast a ray to the point's exact position.",
    ),
    "MATERIAL_DISAGREES": (
        "Point ids or material coordinates are permuted.",
        "Compare `points.parquet` with the surface channels.",
    ),
    "OFFSET_DISAGREES": (
        "Half a pixel between tables and images.",
        "Put the first pixel's centre at (0.5, 0.5) in both.",
    ),
    "OFFSET_SCATTERS": ("Positions were rounded or perturbed.", "Write exact projections."),
    "DEPTH_IMAGE_DISAGREES": (
        "Another unit or camera of the depth images.",
        "Write planar depth in metres.",
    ),
    "DEPTH_IMAGE_SCATTERS": ("Noisy or quantised depth.", "Write the renderer's exact depth."),
    "PRECISION_LOST": (
        "Values went through float16, 8 bits or millimetres.",
        "Keep float32 from the renderer to the file.",
    ),
    "SCALE_DISAGREES": ("Millimetres instead of metres.", "Correct `metres_per_unit`."),
    "COLOUR_DISAGREES": (
        "Colour images are shifted, flipped or of other frames.",
        "Compare colour and depth images of a frame.",
    ),
    "COLOUR_DOUBTFUL": (
        "Low contrast between object and background, or noise.",
        "Look at the pictures; ignore it if they are right.",
    ),
    "PARTNER_DISAGREES": (
        "The order of partners differs from that of the symmetries.",
        "List one partner per symmetry, in order.",
    ),
    "POINTS_DIFFER": (
        "Points were sampled for each sequence separately.",
        "Use one point table per tier.",
    ),
    "SUMMARY_DISAGREES": (
        "Correspondences changed after the summary.",
        "Compute `self_occluded` again.",
    ),
    "QUERY_INVALID": ("Sequences were renamed or removed.", "Draw the queries again."),
    "QUERY_NOT_VISIBLE": (
        "Rounded positions, or hidden points.",
        "Copy (u_px, v_px) of visible points bit for bit.",
    ),
    "TRUTH_DISAGREES": (
        "Correspondences changed after the truth.",
        "Compute the truth again from frame B.",
    ),
    "QUERIES_MISMATCH": (
        "The answers are to another version of the queries.",
        "Predict again with the queries of this dataset.",
    ),
    "DATASET_MISMATCH": ("A file of another dataset.", "Pass the dataset that it answers."),
    "SPLIT_MISMATCH": ("A file of another split.", "Pass `--split`, or the right file."),
    "MODES_INVALID": (
        "Weights are not normalised, or `sigma` is present too.",
        "Normalise weights per row; write `sigma` or `modes`.",
    ),
}
"""Code -> (usual cause, remedy)."""
