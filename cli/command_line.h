#pragma once

namespace lightrig::cli {

/// Runs what the arguments say; the exit code: 0 done, 1 it failed, 2 usage.
int run(int argc, char** argv);

}  // namespace lightrig::cli
