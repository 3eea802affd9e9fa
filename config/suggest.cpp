#include "config/suggest.h"

#include <algorithm>
#include <cctype>
#include <vector>

namespace lightrig {
namespace {

char lower(char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }

// Words of a key are apart by "_", in a name by "-" or " ": which one was typed is not a mistake
// worth counting.
bool same(char a, char b) {
  const auto folded = [](char c) { return c == '-' || c == ' ' ? '_' : lower(c); };
  return folded(a) == folded(b);
}

bool begins_with(std::string_view longer, std::string_view shorter) {
  return shorter.size() >= 3 && longer.size() >= shorter.size() &&
         std::equal(shorter.begin(), shorter.end(), longer.begin(), same);
}

}  // namespace

int edit_distance(std::string_view a, std::string_view b) {
  const std::size_t n = b.size();
  std::vector<int> before(n + 1), last(n + 1), row(n + 1);
  for (std::size_t j = 0; j <= n; ++j) last[j] = static_cast<int>(j);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = static_cast<int>(i);
    for (std::size_t j = 1; j <= n; ++j) {
      const bool equal = same(a[i - 1], b[j - 1]);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (equal ? 0 : 1)});
      if (i > 1 && j > 1 && same(a[i - 1], b[j - 2]) && same(a[i - 2], b[j - 1]))
        row[j] = std::min(row[j], before[j - 2] + 1);
    }
    std::swap(before, last);
    std::swap(last, row);
  }
  return last[n];
}

std::string nearest(std::string_view wrong, std::span<const std::string> names) {
  const std::string* best = nullptr;
  int best_distance = 0;
  for (const std::string& name : names) {
    const int distance = edit_distance(wrong, name);
    const int allowed = std::max<int>(1, static_cast<int>(std::max(wrong.size(), name.size())) / 3);
    const bool near = distance <= allowed || begins_with(name, wrong) || begins_with(wrong, name);
    if (near && (best == nullptr || distance < best_distance)) {
      best = &name;
      best_distance = distance;
    }
  }
  return best == nullptr ? std::string{} : *best;
}

std::string did_you_mean(std::string_view wrong, std::span<const std::string> names) {
  const std::string name = nearest(wrong, names);
  return name.empty() ? name : "did you mean \"" + name + "\"?";
}

}  // namespace lightrig
