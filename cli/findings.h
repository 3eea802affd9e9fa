#pragma once

#include <string>
#include <vector>

#include "cli/json_fields.h"

namespace lightrig::cli {

/// What one check of a rig found. What nobody saw and nothing measured is not proven, and no pass;
/// what the rig has not got is absent, and said to be.
struct Finding {
  enum class Outcome : std::uint8_t { passed, failed, not_proven, absent } outcome;
  std::string what;
};

inline Finding passed(std::string what) { return {Finding::Outcome::passed, std::move(what)}; }
inline Finding failed(std::string what) { return {Finding::Outcome::failed, std::move(what)}; }
inline Finding absent(std::string what) { return {Finding::Outcome::absent, std::move(what)}; }
inline Finding not_proven(std::string what) {
  return {Finding::Outcome::not_proven, std::move(what)};
}

/// The outcome in a word: "passed", "FAILED", "not proven", "absent".
const char* word_of(Finding::Outcome outcome);

/// The checks of one rig in the order in which they were made, and what they come to.
class Findings {
 public:
  void add(const std::string& check, const std::string& how, const Finding& found,
           const std::string& at);

  /// {"passed": whether every check did, "failed", "not_proven", "absent": the names of the others,
  /// "checks": all}. A rig that lacks a protection has not passed, whatever else it proves.
  Json json() const;
  /// Whether nothing failed and nothing is unproven: what the rig has got has passed.
  bool all_it_has() const;
  /// One line for a person, with the name of every check that did not pass.
  std::string verdict() const;

 private:
  std::vector<std::string> names(Finding::Outcome outcome) const;

  struct Checked {
    std::string check;
    Finding::Outcome outcome;
  };
  std::vector<Checked> checked_;
  Json checks_ = Json::array();
};

}  // namespace lightrig::cli
