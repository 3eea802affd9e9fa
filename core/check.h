#pragma once

#include <cstdio>
#include <cstdlib>

/// Ends the process when a promise of ours is broken. The world's failures are Result<T>, never
/// CHECK.
#define CHECK(condition)                                                                   \
  do {                                                                                     \
    if (!(condition)) {                                                                    \
      std::fprintf(stderr, "%s:%d: broken promise: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                        \
    }                                                                                      \
  } while (false)
