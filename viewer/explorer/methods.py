"""The methods of an explorer, of any kind."""

from __future__ import annotations

from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.submissions import RecordedMethod, ReportMethod

Method = LiveMethod | RecordedMethod | ReportMethod
