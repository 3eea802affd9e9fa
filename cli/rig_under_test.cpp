#include "cli/rig_under_test.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <numbers>

namespace lightrig::cli {
namespace {

double per_si(const std::string& unit) {
  return unit == "deg" ? 180 / std::numbers::pi : unit == "mm" ? 1e3 : 1;
}

std::string to_member(const Json& axis) {
  return text(axis, "unit").empty() ? "to" : fmt::format("to_{}", text(axis, "unit"));
}

}  // namespace

RigUnderTest::RigUnderTest(const CommissionOptions& options)
    : client_(options.service),
      socket_(options.service.socket),
      out_(options.service.json ? stderr : stdout),
      ask_(!options.yes) {}

Result<void> RigUnderTest::look() {
  auto rig = client_.get_json("/v1/rig");
  if (!rig) return tl::unexpected(rig.error());
  facts_ = std::move(*rig);
  return {};
}

bool RigUnderTest::person_says(const std::string& question) const {
  if (!ask_) return true;
  fmt::print(out_, "  {} [y/n] ", question);
  std::fflush(out_);
  std::string answer;
  return std::getline(std::cin, answer) && !answer.empty() &&
         (answer[0] == 'y' || answer[0] == 'Y');
}

Finding RigUnderTest::seen(const std::string& measured, const std::string& question) const {
  if (!ask_) return not_proven(measured + "; nobody was asked: " + question);
  return person_says(question) ? passed(measured + "; seen by a person")
                               : failed(measured + "; but a person says no: " + question);
}

Result<std::string> RigUnderTest::carry_out(const std::string& path, const Json& body) const {
  const auto reply = client_.post(path, body);
  if (!reply) return tl::unexpected(reply.error());
  return client_.wait_for(reply->value("command", std::uint64_t{0}));
}

Json RigUnderTest::status() const {
  return client_.get_json("/v1/status").value_or(Json::object());
}

Result<std::string> RigUnderTest::armed() const {
  if (status().value("armed", false)) return std::string();
  return carry_out("/v1/arm");
}

Result<std::string> RigUnderTest::armed_and_homed() const {
  if (auto done = armed(); !done) return done;
  const Json now = status();
  if (part(part(now, "devices"), "gantry").value("homed", false)) return std::string();
  return carry_out("/v1/home");
}

double RigUnderTest::position(const std::string& axis) const {
  const Json now = status();
  const Json& at = part(part(part(now, "devices"), "gantry"), "position");
  const Json& axes = part(facts_, "axes");
  for (std::size_t i = 0; i < axes.size(); ++i)
    if (text(axes[i], "name") == axis && at.is_array() && i < at.size() && at[i].is_number())
      return at[i].get<double>() * per_si(text(axes[i], "unit"));
  return std::nan("");
}

Result<std::string> RigUnderTest::move_to(const Json& axis, double to) const {
  return carry_out("/v1/jog", {{"axis", text(axis, "name")}, {to_member(axis), to}});
}

std::optional<Result<Json>> RigUnderTest::long_move() const {
  const Json& axes = part(facts_, "axes");
  const auto moving =
      std::ranges::find_if(axes, [](const Json& one) { return !text(one, "unit").empty(); });
  if (moving == axes.end()) return {};
  const std::string name = text(*moving, "name");
  const double from = position(name), low = (*moving)["min"].get<double>(),
               high = (*moving)["max"].get<double>();
  const double to = high - from > from - low ? high : low;
  return client_.post("/v1/jog", {{"axis", name}, {to_member(*moving), to}});
}

}  // namespace lightrig::cli
