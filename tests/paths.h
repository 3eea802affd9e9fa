#pragma once

// Where this build's sources and programs lie. Compiled once, so that no test's own object code
// depends on the folder it was built in and a compiler cache serves every clone.
namespace lightrig::test {

extern const char* const source_dir;  ///< the repository's top folder, absolute
extern const char* const
    build_dir;  ///< the build folder, where lightrig and lightrigd are, absolute

}  // namespace lightrig::test
