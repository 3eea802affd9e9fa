#include "cli/left_out.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

#include "cli/say.h"

namespace lightrig::cli {
namespace {

std::string count(std::int64_t value) {
  // Groups of three: the counts go into the hundred millions.
  std::string digits = std::to_string(value);
  for (int at = static_cast<int>(digits.size()) - 3; at > 0; at -= 3)
    digits.insert(static_cast<std::size_t>(at), 1, ',');
  return digits;
}

}  // namespace

std::string left_out_table(const std::vector<LeftOutLine>& lines,
                           const std::vector<std::string>& drivers_not_opened) {
  std::vector<std::vector<std::string>> rows;
  for (const LeftOutLine& line : lines)
    rows.push_back({line.why.empty() ? line.what : fmt::format("{} ({})", line.what, line.why),
                    count(line.left_out), line.of ? count(*line.of) : ""});
  std::string text = table({"not needed by this scene", "left out", "of"}, rows);
  if (!drivers_not_opened.empty())
    text += fmt::format("drivers not opened: {}\n", fmt::join(drivers_not_opened, ", "));
  return text;
}

}  // namespace lightrig::cli
