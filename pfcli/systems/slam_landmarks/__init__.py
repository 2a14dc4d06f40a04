"""FastSLAM with Gaussian distributed resampling: `slam-gdr --landmarks`."""
