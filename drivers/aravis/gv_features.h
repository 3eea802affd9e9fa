#pragma once

#include <arv.h>

#include <string>
#include <vector>

#include "core/result.h"

namespace lightrig {

// GenICam features of an open camera, by name; every write is read back. Errors: refused (not
// accepted, or another value read back), not_found, disconnected.

/// A feature exists and can be used now; a model that lacks it is no failure.
bool has_feature(ArvCamera* camera, const char* name);
bool has_entry(ArvCamera* camera, const char* feature, const char* entry);
/// The entries of an enumeration that can be chosen now; none where it is missing.
std::vector<std::string> entries_of(ArvCamera* camera, const char* feature);

/// Copies a getter's string at once: it goes stale with the next call.
inline std::string text_of(const char* text) { return text ? text : "?"; }
/// A feature's value in words, whatever its type; "" where it cannot be read.
std::string value_of(ArvCamera* camera, const char* feature);

/// Sets an enumeration or string feature.
Result<void> set_text(ArvCamera* camera, const std::string& feature, const std::string& value);
/// Sets a whole number; one that is set already is not written, since a model may have locked it.
Result<void> set_whole(ArvCamera* camera, const std::string& feature, gint64 value);
/// Switches a boolean feature off; one that is off already is not written. `else_what`: what a
/// camera that keeps it on would spoil, and the remedy.
Result<void> set_off(ArvCamera* camera, const std::string& feature, const std::string& else_what);
/// Sets the gain nearest to none at all, under the selector as it stands.
Result<void> set_least_gain(ArvCamera* camera);
/// Any GenICam feature of the rig file, by the type of its node.
Result<void> set_any(ArvCamera* camera, const std::string& feature, const std::string& value);

}  // namespace lightrig
