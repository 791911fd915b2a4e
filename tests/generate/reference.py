"""Writes fixtures/golden/lego64.safetensors: a reference render of fixtures/trained/lego64.

    python3 tests/generate/reference.py FOLDER_OF_REFERENCE_RENDERS

Copies, bit for bit, what the float64 renderer made of the first test camera without the threshold on
colour, which is a step: colour, transmittance and accumulated values. Python 3.11 and NumPy 2, from the
repository's root.
"""
import sys
import tensor_file

arrays = tensor_file.read(f"{sys.argv[1]}/r_0.safetensors")
names = ["nothreshold.rgb", "nothreshold.transmittance", "nothreshold.accumulated"]
tensor_file.write("fixtures/golden/lego64.safetensors", {name: arrays[name] for name in names})
