#!/usr/bin/env bash
# The same bytes from every build, processor and machine: bakes, unpacks and validates with the debug build, then with
# others, and compares all that was written.
#
#   tests/portability/run.sh                             without the vector instructions of this processor
#   tests/portability/run.sh release                     and the release build, with and without them
#   tests/portability/run.sh aarch64-unknown-linux-gnu   and a build for another machine
#
# Debian: qemu-user, and for another machine gcc-aarch64-linux-gnu and libc6-dev-arm64-cross, or gcc-s390x-linux-gnu and
# libc6-dev-s390x-cross (whose bytes lie the other way round); rustup target add TARGET.
set -euo pipefail
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-target}
folder=$(mktemp -d)
trap 'rm -r "$folder"' EXIT
# Link-time optimization takes minutes, and is not what could change bytes.
export CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=16

# Writes into a folder all that is to be the same, with the command that follows.
everything() {
    local out="$folder/$1" trained=fixtures/trained
    shift
    mkdir "$out"
    bake() {
        "${program[@]}" --quiet bake "$trained/$1" -o "$out/$2.mipvog" "${@:3}"
    }
    local program=("$@")
    bake tiny/fine_last.tar rate --gltf "$out/rate.glb" --fallback-triangles 500
    bake tiny/fine_last.tar code --filter code
    bake tiny/fine_last.tar paper --filter paper --bits 12 --zstd-level 3
    bake tiny/fine_last.tar error --max-error 0.01
    bake tiny/fine_last.tar seen --turntable 2 --size 24x16 --coarseness 0.25 --min-weight 1e-3
    bake dvgo/protocol2.tar fit --filter fit --fit-steps 1 --levels 2
    bake dvgo/protocol2.tar mask --filter coverage --bits f16
    bake dvgo/flat_bfloat16.safetensors exact --bits f32
    local container
    for container in fixtures/baked/*.mipvog fixtures/frozen/*/*.mipvog; do
        "${program[@]}" --quiet unpack "$container" -o "$out/${container//\//.}.safetensors"
        "${program[@]}" validate "$container" >> "$out/validated"
    done
    (cd "$out" && sha256sum -- * > ../sums)
    mv "$folder/sums" "$out.sums"
    rm -r "$out"
}

# Holds a run to the first one.
same() {
    everything "$@"
    diff "$folder/debug.sums" "$folder/$1.sums" || { echo "$1: other bytes" >&2; exit 1; }
    echo "$1: the same bytes"
}

build() {
    cargo build --quiet --locked --bin mipvog-bake "$@"
}

build
everything debug "$target/debug/mipvog-bake"
# The first processor of its kind has no more than SSE3, so every loop takes its plain form.
same debug-plain qemu-x86_64 -cpu qemu64 "$target/debug/mipvog-bake"
for other in "$@"; do
    if [ "$other" = release ]; then
        build --release
        same release "$target/release/mipvog-bake"
        same release-plain qemu-x86_64 -cpu qemu64 "$target/release/mipvog-bake"
        continue
    fi
    machine=${other%%-*}
    variable=CARGO_TARGET_$(tr 'a-z-' 'A-Z_' <<< "$other")_LINKER
    export "$variable=$machine-linux-gnu-gcc"
    build --release --target "$other"
    same "$machine" "qemu-$machine" -L "/usr/$machine-linux-gnu" "$target/$other/release/mipvog-bake"
done
