"""What can be wrong with a live camera, in words that say what to do; never with its credentials.

FFmpeg's own messages end with the address as it was given, so that only their code and its fixed text are used.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass

import av.error
from av.video.stream import VideoStream

from recognition.errors import StreamError
from recognition.sources.urls import SourceUrl

_RETRIED = "it is tried again until it answers"

_NAME_UNKNOWN = ", which is what FFmpeg makes of a host name that nobody knows"


@dataclass(frozen=True, slots=True)
class RtspFaults:
    """Makes the errors of one camera."""

    camera_id: str
    url: SourceUrl

    def not_opened(self, error: av.error.FFmpegError, timeout_s: float, *, is_late: bool) -> StreamError:
        """No session with the camera; ``is_late``: since the time was over, whatever was made of that."""
        if isinstance(error, av.error.HTTPUnauthorizedError | av.error.HTTPForbiddenError):
            shown = "with the user and password of the address" if self.url.has_login else "without user and password"
            return self._error(
                f"camera {self.camera_id} refuses the login",
                expected="a user and password that may look at this camera",
                got=f"{_text(error)} {shown}",
                do_next="give them in the address, rtsp://USER:PASSWORD@HOST/PATH, with / @ : and % in them as %2F %40 "
                "%3A %25",
            )
        if isinstance(error, av.error.HTTPNotFoundError):
            return self._error(
                f"camera {self.camera_id} has no stream at this path",
                expected="the path of one of its streams",
                got=_text(error),
                do_next="take the whole address from the camera's page or from its ONVIF profile",
            )
        if isinstance(error, av.error.HTTPError | av.error.InvalidDataError) and not is_late:
            return self._error(
                f"camera {self.camera_id} answers, but gives no stream",
                expected="an RTSP server that describes H.264 video",
                got=_text(error),
                do_next=f"look at the stream in another player; restart the camera; {_RETRIED}",
            )
        return self._error(
            f"camera {self.camera_id} cannot be reached",
            expected=f"an RTSP server that answers within {timeout_s:g} s",
            got="no answer" if is_late else _text(error) + _NAME_UNKNOWN * (error.errno == errno.EIO),
            do_next=f"check the address, the port, the cable and the camera's power; {_RETRIED}",
        )

    def no_video(self) -> StreamError:
        """A session without pictures."""
        return self._error(
            f"camera {self.camera_id} sends no video",
            expected="an H.264 video stream",
            got="none",
            do_next="take the address of the camera's video stream; switch video on in the camera",
        )

    def other_codec(self, stream: VideoStream) -> StreamError:
        """Video that cannot be recorded as it is."""
        return self._error(
            f"camera {self.camera_id} sends video of another codec",
            expected="H.264, which can be recorded as it is and shown anywhere",
            got=stream.codec_context.name if stream.codec_context else "an unknown codec",
            do_next="set the video codec of this stream to H.264 in the camera, without B-frames",
        )

    def broke(self, error: av.error.FFmpegError, timeout_s: float) -> StreamError:
        """A session that ended with an error."""
        if isinstance(error, av.error.ExitError | av.error.TimeoutError):
            return self._error(
                f"camera {self.camera_id} sends no more frames",
                expected=f"a frame every {timeout_s:g} s or sooner",
                got=f"nothing for {timeout_s:g} s",
                do_next=f"check the camera's power and the network; {_RETRIED}",
            )
        return self._error(
            f"the connection to camera {self.camera_id} broke",
            expected="frames without end",
            got=_text(error),
            do_next=f"check the camera's power and the network; {_RETRIED}",
        )

    def hung_up(self) -> StreamError:
        """A session that the camera ended."""
        return self._error(
            f"camera {self.camera_id} closed the connection",
            expected="frames without end",
            got="the end of the stream",
            do_next=f"see how many viewers the camera allows, and whether it restarts; {_RETRIED}",
        )

    def times_ran_back(self, by_s: float) -> StreamError:
        """Frames out of order."""
        return self._error(
            f"the frames of camera {self.camera_id} are out of order",
            expected="frame times that ascend",
            got=f"a frame {-by_s:.3f} s before the last one",
            do_next="switch B-frames off in the camera (H.264 profile Baseline, or B-frames 0)",
        )

    def times_jumped(self, by_s: float) -> StreamError:
        """A media clock that started anew."""
        return self._error(
            f"the frame times of camera {self.camera_id} jumped",
            expected="a media clock that runs with time",
            got=f"{by_s:+.3f} s at once",
            do_next="nothing where it happens once, the connection is made anew; else restart or update the camera",
        )

    def no_key_frame(self, waited_s: float) -> StreamError:
        """A session in which decoding cannot begin."""
        return self._error(
            f"camera {self.camera_id} sends no key frames",
            expected=f"an IDR frame with its parameter sets within {waited_s:g} s",
            got="none",
            do_next="set the camera's key frame (I-frame) interval to 1 or 2 s, without intra refresh",
        )

    def no_reports(self, waited_s: float) -> StreamError:
        """A camera that does not say when it took its frames."""
        return self._error(
            f"camera {self.camera_id} does not say when it took its frames",
            expected=f"an RTCP sender report with the camera's wall clock within {waited_s:g} s",
            got="none",
            do_next="switch RTCP and NTP time on in the camera, or update its firmware; times of arrival are not used "
            "instead, since they are late by an unknown amount",
        )

    def wrong_clock(self, off_s: float, limit_s: float, *, is_measured: bool) -> StreamError:
        """Capture times that cannot be."""
        known = "with the clock model of the rig file" if is_measured else "without a clock model in the rig file"
        return self._error(
            f"the clock of camera {self.camera_id} is wrong",
            expected=f"capture times within {limit_s:g} s of their arrival",
            got=f"{off_s:+.3f} s, {known}",
            do_next="set the camera's time by NTP from this machine (rigcal sync serve) and measure its clock: rigcal "
            "sync probe",
        )

    def clock_set_back(self, by_s: float) -> StreamError:
        """A camera that came back with an earlier time."""
        return self._error(
            f"the clock of camera {self.camera_id} was set back",
            expected="capture times after those of its earlier frames",
            got=f"{by_s:+.3f} s",
            do_next="measure its clock again: rigcal sync probe; its frames are used again once they have caught up "
            "with the earlier ones",
        )

    def _error(self, what: str, *, expected: str, got: str, do_next: str) -> StreamError:
        return StreamError(what, where=self.url, expected=expected, got=got, do_next=do_next)


def _text(error: av.error.FFmpegError) -> str:
    """FFmpeg's fixed text for an error's code."""
    return error.strerror or type(error).__name__
