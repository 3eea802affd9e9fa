#pragma once

#include <string>
#include <vector>

#include "core/result.h"

namespace lightrig::cli {

/// Prints to standard output.
void say(const std::string& text);

/// "lightrig: doing: message" on standard error; returns exit code 1.
int complain(const Error& error);
int complain(const std::string& message);

/// True when standard output is a terminal.
bool on_terminal();
/// Columns of the terminal; 80 when it does not say.
int terminal_width();

/// A table with right-aligned columns, except the first; columns as wide as needed.
std::string table(const std::vector<std::string>& heads,
                  const std::vector<std::vector<std::string>>& rows);

/// "3 s", "2 min 05 s", "1 h 12 min".
std::string duration(double seconds);
/// "4.27 %", "–" for NaN.
std::string percent(double value);
/// Four significant digits, "∞" for infinity, "–" for NaN.
std::string figure(double value);
/// "1.5 GiB".
std::string bytes(double value);

}  // namespace lightrig::cli
