#pragma once

#include <cstdio>
#include <optional>
#include <string>

#include "cli/findings.h"
#include "cli/json_fields.h"
#include "cli/service_client.h"
#include "cli/verbs.h"
#include "core/result.h"

namespace lightrig::cli {

/// A rig that is being proven: what is asked of it through its service, and of the person beside
/// it.
class RigUnderTest {
 public:
  explicit RigUnderTest(const CommissionOptions& options);

  /// Reads what the service says of its rig. Errors: no service answers.
  Result<void> look();
  /// As GET /v1/rig has it.
  const Json& facts() const { return facts_; }
  /// The lamp's power by which it is lit [0, 1].
  const Json& power() const { return facts_["lamp"]["power"]; }
  const std::string& socket() const { return socket_; }

  /// Where what is said on the way goes: with --json the record alone is the output.
  std::FILE* out() const { return out_; }
  bool asks() const { return ask_; }
  /// A person's answer; without a person, go on.
  bool person_says(const std::string& question) const;
  /// What only eyes can tell is not proven without them.
  Finding seen(const std::string& measured, const std::string& question) const;

  Result<Json> post(const std::string& path, const Json& body = Json::object()) const {
    return client_.post(path, body);
  }
  Result<std::string> wait_for(std::uint64_t command) const { return client_.wait_for(command); }
  /// Sends a command and waits for its end.
  Result<std::string> carry_out(const std::string& path, const Json& body = Json::object()) const;
  /// The status; an empty object where the service does not answer.
  Json status() const;
  Result<std::string> armed() const;
  Result<std::string> armed_and_homed() const;
  /// Where an axis stands, in the unit of the rig file; NaN where that is not known.
  double position(const std::string& axis) const;
  /// Moves an axis of facts() there, in the unit of the rig file.
  Result<std::string> move_to(const Json& axis, double to) const;
  /// The longest move that the first moving axis has, under way; empty where nothing moves.
  std::optional<Result<Json>> long_move() const;

 private:
  ServiceClient client_;
  std::string socket_;
  std::FILE* out_;
  bool ask_;
  Json facts_;
};

}  // namespace lightrig::cli
