"""Export of a diagram: C source, MAT files for MATLAB and Simulink."""

from tsmblocks.export.c import Code as Code
from tsmblocks.export.c import to_c as to_c
from tsmblocks.export.mat import to_mat as to_mat
