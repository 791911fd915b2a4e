"""Bakes the fixture of each system, and prints how far the bake is from the model by its own rules.

    python3 benches/losses.py target/release/mipvog-bake [NAME...]

Four cameras from `compare`'s ring, which stands inside worlds; 200 x 200 pixels and a quarter of
that. NAME picks models whose names contain it.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures"
# Each with its file and options. 65 nodes keep networks from taking minutes.
MODELS = {
    "DirectVoxGO, network once per ray": ["trained/tiny/fine_last.tar"],
    "DirectVoxGO, network per sample": ["lego/dvgo.tar", "--near", "2"],
    "DirectVoxGO without rgbnet_direct": ["grids/dvgo_residual.tar", "--near", "2"],
    "DirectVoxGO with TensoRFGrid": ["grids/dvgo_tensorf_grid.tar"],
    "DirectVoxGO, unbounded": ["worlds/dvgo_unbounded.tar", "--resolution", "65"],
    "Plenoxels": ["lego/plenoxels.npz"],
    "Plenoxels, background spheres": ["grids/plenoxels_spheres.npz"],
    "PlenOctrees": ["lego/plenoctree.npz"],
    "TensoRF, VM, network": ["lego/tensorf.th"],
    "TensoRF, CP, network": ["grids/tensorf_cp.th"],
    "TensoRF, VM, SH": ["grids/tensorf_vm_sh.th"],
    "TensoRF, VM, RGB": ["grids/tensorf_vm_relu_rgb.th"],
    "nerfstudio's tensorf": ["lego/ns_tensorf"],
    "MERF": ["worlds/merf_whole"],
    "Instant-NGP, aabb_scale 4": ["worlds/ngp_aabb4.ingp", "--resolution", "65"],
    "torch-ngp": ["lego/torch_ngp.pth", "--resolution", "65", "--scene-scale", "0.8"],
    "nerfacto, PyTorch": ["worlds/nerfacto_tiny", "--resolution", "65"],
    "nerfacto, tiny-cuda-nn": ["worlds/nerfacto_tcnn", "--resolution", "65"],
    "SVRaster, quantized": ["voxels/svraster_quantized.pt"],
    "SVRaster, unbounded": ["voxels/svraster_unbounded.pt"],
    "GeoSVR": ["voxels/svraster_geosvr.pt"],
    "OpenVDB": ["vdb/smoke.vdb"],
}
SIZE, FRAMES, SCALES = 200, 4, (1, 4)


def bytes_of(path):
    """Of a file, or of all files of a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def measure(program, model, options, output):
    """PSNR in dB by scale, and the bytes of the container."""
    common = [program, "bake", model, *options, "-o", output, "--force", "-q"]
    subprocess.run(list(map(str, common)), check=True, capture_output=True)
    # Options of the input alone, as the bake took them.
    kept = [options[at : at + 2] for at in range(0, len(options), 2)]
    of_input = sum((pair for pair in kept if pair[0] != "--resolution"), [])
    words = [program, "compare", model, output, "--size", SIZE, "--frames"]
    words += [",".join(map(str, range(FRAMES))), "--scales", ",".join(map(str, SCALES))]
    words += [*of_input, "--format", "json"]
    told = subprocess.run(list(map(str, words)), check=True, capture_output=True).stdout
    return [scale["psnr"] for scale in json.loads(told)["scales"]], bytes_of(output)


def main():
    program, *names = sys.argv[1:]
    print("| model | model, kB | container, kB | 1/1, dB | 1/4, dB |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, (file, *options) in MODELS.items():
            if names and not any(part in name for part in names):
                continue
            model = FIXTURES / file
            psnr, size = measure(program, model, options, Path(folder) / "scene.mipvog")
            row = [name, f"{bytes_of(model) / 1e3:.0f}", f"{size / 1e3:.0f}"]
            print("| " + " | ".join(row + [f"{value:.1f}" for value in psnr]) + " |", flush=True)


if __name__ == "__main__":
    main()
