# The program in an image of nothing else: docker build -t mipvog-bake .
FROM rust:1-slim AS build
RUN apt-get update && apt-get install --yes --no-install-recommends musl-tools
WORKDIR /source
COPY . .
RUN target=$(uname -m)-unknown-linux-musl \
    && rustup target add "$target" \
    && cargo build --release --locked --features network --target "$target" \
    && cp "target/$target/release/mipvog-bake" /mipvog-bake

FROM scratch
# For inputs at https addresses.
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
COPY --from=build /mipvog-bake /mipvog-bake
# Where inputs without a name are spooled.
WORKDIR /tmp
WORKDIR /data
ENTRYPOINT ["/mipvog-bake"]
