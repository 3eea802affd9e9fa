#include "cli/findings.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace lightrig::cli {

const char* word_of(Finding::Outcome outcome) {
  switch (outcome) {
    case Finding::Outcome::passed:
      return "passed";
    case Finding::Outcome::failed:
      return "FAILED";
    case Finding::Outcome::not_proven:
      return "not proven";
    case Finding::Outcome::absent:
      return "absent";
  }
  return "unknown";
}

void Findings::add(const std::string& check, const std::string& how, const Finding& found,
                   const std::string& at) {
  checked_.push_back({check, found.outcome});
  checks_.push_back({{"check", check},
                     {"how", how},
                     {"outcome", word_of(found.outcome)},
                     {"found", found.what},
                     {"at", at}});
}

std::vector<std::string> Findings::names(Finding::Outcome outcome) const {
  std::vector<std::string> names;
  for (const Checked& one : checked_)
    if (one.outcome == outcome) names.push_back(one.check);
  return names;
}

Json Findings::json() const {
  return {{"passed", names(Finding::Outcome::passed).size() == checked_.size()},
          {"failed", names(Finding::Outcome::failed)},
          {"not_proven", names(Finding::Outcome::not_proven)},
          {"absent", names(Finding::Outcome::absent)},
          {"checks", checks_}};
}

bool Findings::all_it_has() const {
  return names(Finding::Outcome::failed).empty() && names(Finding::Outcome::not_proven).empty();
}

std::string Findings::verdict() const {
  std::string words = fmt::format("{} of {} checks passed", names(Finding::Outcome::passed).size(),
                                  checked_.size());
  for (const auto outcome :
       {Finding::Outcome::failed, Finding::Outcome::not_proven, Finding::Outcome::absent})
    if (const auto others = names(outcome); !others.empty())
      words += fmt::format("; {}: {}", word_of(outcome), fmt::join(others, ", "));
  return words;
}

}  // namespace lightrig::cli
