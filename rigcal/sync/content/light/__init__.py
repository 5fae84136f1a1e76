"""Clocks from a light that is switched: when each camera must have seen it, as linear inequalities."""

from rigcal.sync.content.light.brightness import BrightnessSeries, measure_brightness
from rigcal.sync.content.light.lags import LightOptions, light_lags

__all__ = ["BrightnessSeries", "LightOptions", "light_lags", "measure_brightness"]
