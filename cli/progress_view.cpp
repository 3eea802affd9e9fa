#include "cli/progress_view.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "cli/json_fields.h"
#include "cli/say.h"

namespace lightrig::cli {
namespace {

std::string bar(double part, int cells) {
  const int full = static_cast<int>(std::lround(std::clamp(part, 0.0, 1.0) * cells));
  std::string text;
  for (int i = 0; i < cells; ++i) text += i < full ? "█" : "░";
  return text;
}

/// Code points: what this program writes takes one column each.
int columns(std::string_view text) {
  return static_cast<int>(std::ranges::count_if(
      text, [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string cut_to(const std::string& text, int width) {
  if (columns(text) <= width) return text;
  std::string cut;
  int count = 0;
  for (const char c : text) {
    const bool begins = (static_cast<unsigned char>(c) & 0xC0) != 0x80;
    if (begins && ++count > std::max(width - 1, 0)) break;
    cut += c;
  }
  return cut + "…";
}

std::string error_words(const Json& progress) {
  std::string words;
  const double predicted = number(progress, "predicted_error_percent");
  const double truth = number(progress, "true_error_percent");
  if (std::isfinite(predicted) && predicted > 0)
    words += fmt::format("error ≈ {:.1f} %", predicted);
  if (std::isfinite(truth)) words += fmt::format(" (true {:.1f} %)", truth);
  return words;
}

}  // namespace

std::string progress_line(const Json& progress, int width) {
  const double percent = number(progress, "percent");
  const int done = progress.value("shots_done", 0), total = progress.value("shots_total", 0);
  const std::string left = fmt::format("{} left", duration(number(progress, "remaining_s")));
  const std::string facts =
      fmt::format("{:3.0f} %  {}/{} lights  {}  {}", std::isfinite(percent) ? percent : 0, done,
                  total, left, error_words(progress));
  const std::string activity = progress.value("activity", "");
  // The facts stand; the bar gives way first, then the words. The last column stays free: a
  // terminal that wraps there would leave every line behind.
  const int room = width - 1 - columns(facts) - 3;
  const int cells = std::clamp(room - columns(activity), std::min(8, std::max(room, 0)), 30);
  return cut_to(fmt::format("{} {}  {}", bar(percent / 100, cells), facts, activity), width - 1);
}

std::string standing_warning(const Json& event) {
  if (text(event, "event") != "pose") return {};
  const Json& fields = part(event, "fields");
  const std::string reason = text(fields, "reason");
  return reason.empty() ? reason : fmt::format("WARNING, at {}: {}", text(fields, "name"), reason);
}

void ProgressView::show(const Json& progress) {
  if (terminal_) {
    std::fprintf(stdout, "\r\x1b[K%s", progress_line(progress, width_).c_str());
    std::fflush(stdout);
    drawn_ = true;
    return;
  }
  // Plain: a line per light, so that a log stays readable.
  const std::string key =
      fmt::format("{}/{}", progress.value("shots_done", 0), progress.value("shots_total", 0));
  if (key == last_) return;
  last_ = key;
  say(fmt::format("{:.0f} %  {} lights  {} left  {}  {}",
                  std::isfinite(number(progress, "percent")) ? number(progress, "percent") : 0, key,
                  duration(number(progress, "remaining_s")), error_words(progress),
                  progress.value("activity", "")));
}

void ProgressView::note(const std::string& line) {
  if (terminal_ && drawn_) std::fputs("\r\x1b[K", stdout);
  drawn_ = false;
  say(line);
}

void ProgressView::end() {
  if (terminal_ && drawn_) std::fputc('\n', stdout);
  drawn_ = false;
  std::fflush(stdout);
}

}  // namespace lightrig::cli
