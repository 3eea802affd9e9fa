# build PRESET [TARGET…]: configures and builds quietly; on failure shows what the tools said. Sourced by the set-up commands.
build() {
  local preset=$1 log="build/$1.log" start=$SECONDS
  shift
  mkdir -p build
  cmake --preset "$preset" >"$log" 2>&1 || { cat "$log" >&2; echo "build: configuring $preset failed" >&2; exit 1; }
  cmake --build --preset "$preset" -j "$(nproc)" --target "$@" >"$log" 2>&1 ||
    { tail -n 60 "$log" >&2; echo "build: $preset failed; all of it is in $log" >&2; exit 1; }
  echo "build: $preset ready after $((SECONDS - start)) s"
}
