// What others may know of the service and ask of it without touching the rig: lock, disk, snapshot.
#include <fmt/format.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "daemon/service/service.h"
#include "drivers/reach.h"

namespace lightrig {
namespace {

constexpr std::uintmax_t least_free_bytes = std::uintmax_t{64} << 20;
constexpr std::chrono::milliseconds discovery_patience{500};  ///< a camera answers in a few

}  // namespace

Result<void> Service::may_command(const Caller& caller) const {
  const std::lock_guard lock(mutex_);
  if (!lock_ || lock_->name == caller.name) return {};
  return fail(ErrorCode::refused,
              fmt::format("the rig is locked by {}{}{}; ask them, or take the lock away (lightrig "
                          "unlock --force). ABORT always works",
                          lock_->name, lock_->note.empty() ? "" : ": ", lock_->note));
}

Result<void> Service::lock(const Caller& caller, const std::string& note) {
  if (caller.name.empty())
    return fail(ErrorCode::invalid_input, "a lock needs a name (header X-Lightrig-Client)");
  if (auto may = may_command(caller); !may) return may;
  {
    const std::lock_guard lock(mutex_);
    lock_ = RigLock{caller.name, note};
  }
  log_.info("locked", {{"by", caller.name}, {"peer", caller.peer}, {"note", note}});
  tell_state();
  return {};
}

Result<void> Service::unlock(const Caller& caller, bool force) {
  if (!force)
    if (auto may = may_command(caller); !may) return may;
  {
    const std::lock_guard lock(mutex_);
    lock_.reset();
  }
  log_.info("unlocked",
            {{"by", caller.name}, {"peer", caller.peer}, {"force", force ? "true" : "false"}});
  tell_state();
  return {};
}

// --- the snapshot -------------------------------------------------------------------------------

std::vector<std::string> Service::obstacles() const {
  std::vector<std::string> why;
  if (!is_armed(state_)) {
    const std::string reason = state_reason_.empty() ? "" : fmt::format(" ({})", state_reason_);
    why.push_back(fmt::format("{}{}: {}", name_of(state_), reason, remedy(state_)));
  } else if (state_ != State::armed && state_ != State::done) {
    why.push_back(fmt::format("{}: {}", name_of(state_), remedy(state_)));
  }
  if (lamp_may_be_on_)
    why.push_back(
        "LAMP MAY BE ON: its wire failed before it went dark; look, switch it off by "
        "hand, then arm");
  if (!disk_trouble_.empty()) why.push_back(disk_trouble_);
  if (facts_)
    for (const std::string& input : facts_->gantry.open_interlocks)
      why.push_back(fmt::format("interlock {} is open: close it", input));
  const auto now = SteadyClock::now();
  for (const auto& [device, one] : found_)
    if (!one.good)
      why.push_back(fmt::format("{}: {} ({:.0f} s ago)", device, one.said,
                                std::chrono::duration<double>(now - one.at).count()));
  return why;
}

Snapshot Service::snapshot() const {
  const std::lock_guard lock(mutex_);
  const auto now = SteadyClock::now();
  const auto seconds = [&](SteadyClock::time_point since) {
    return std::chrono::duration<double>(now - since).count();
  };
  Snapshot moment;
  moment.rig = settings_.rig.name;
  moment.simulated = settings_.simulate;
  moment.state = state_;
  moment.state_s = seconds(state_since_);
  moment.uptime_s = seconds(started_);
  moment.busy = active_ != nullptr || slot_.has_value();
  moment.lamp_may_be_on = lamp_may_be_on_;
  moment.why_not_ready = obstacles();
  for (const auto& [device, one] : found_)
    moment.self_test.push_back({device, one.good, one.said, seconds(one.at)});
  moment.lock = lock_;
  moment.facts = facts_;
  moment.session = session_;
  moment.commands.assign(commands_.begin(), commands_.end());
  moment.disk_free_bytes = disk_free_bytes_;
  moment.frames = frames_;
  moment.sessions_done = sessions_done_;
  moment.aborts = aborts_;
  moment.faults = faults_;
  return moment;
}

// --- the self-test ------------------------------------------------------------------------------

void Service::found(const std::string& device, bool good, const std::string& said) {
  found_[device] = {good, said, SteadyClock::now()};
}

// What opening says of all devices outweighs what was seen of one before.
void Service::opened(const Result<RigFacts>& facts) {
  if (settings_.simulate) return;
  const std::lock_guard lock(mutex_);
  ++openings_;
  if (facts)
    for (auto& [device, one] : found_) one = {true, "it was opened", SteadyClock::now()};
  found("opening", facts.has_value(),
        facts ? "gantry, lamp and camera answered; " + facts->camera : facts.error().message);
}

void Service::look_at_devices() {
  const auto idle = [this] {
    const bool still = !is_armed(state_) || state_ == State::armed || state_ == State::done;
    return still && active_ == nullptr && !slot_;
  };
  std::uint64_t openings = 0;
  {
    const std::lock_guard lock(mutex_);
    if (settings_.simulate || !idle()) return;
    openings = openings_;
  }
  const std::vector<Reach> all = reach_of(settings_.rig, discovery_patience);
  const std::lock_guard lock(mutex_);
  if (openings != openings_ || !idle()) return;  // what was opened meanwhile is known better
  for (const Reach& one : all) found(one.device, one.there, one.said);
}

void Service::look_at_disk() {
  const std::string root = settings_.rig.session_root.string();
  struct statvfs facts {};
  std::string trouble;
  std::uintmax_t free_bytes = 0;
  if (statvfs(root.c_str(), &facts) != 0)
    trouble = fmt::format("the session root {} cannot be read: {}", root, std::strerror(errno));
  else
    free_bytes = std::uintmax_t{facts.f_bavail} * facts.f_frsize;
  if (trouble.empty() && access(root.c_str(), W_OK) != 0)
    trouble = fmt::format("the session root {} cannot be written: {}", root, std::strerror(errno));
  if (trouble.empty() && free_bytes < least_free_bytes)
    trouble =
        fmt::format("only {} MiB are free on the disk of {}: free some", free_bytes >> 20, root);
  const std::lock_guard lock(mutex_);
  disk_trouble_ = trouble;
  disk_free_bytes_ = free_bytes;
}

}  // namespace lightrig
