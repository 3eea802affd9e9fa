#pragma once

#include <arv.h>

#include <memory>

namespace lightrig {

/// Drops a GObject when it goes.
struct Unref {
  void operator()(gpointer object) const { g_object_unref(object); }
};
template <class T>
using GRef = std::unique_ptr<T, Unref>;

}  // namespace lightrig
