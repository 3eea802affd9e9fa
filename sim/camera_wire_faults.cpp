#include "sim/camera_wire_faults.h"

#include <array>
#include <utility>

#include "sim/philox.h"

namespace lightrig::sim {
namespace {

constexpr std::array<std::pair<CameraFaultKind, std::string_view>, 12> names = {{
    {CameraFaultKind::packet_lost, "packet_lost"},
    {CameraFaultKind::packet_gone, "packet_gone"},
    {CameraFaultKind::leader_gone, "leader_gone"},
    {CameraFaultKind::trailer_lost, "trailer_lost"},
    {CameraFaultKind::packets_reordered, "packets_reordered"},
    {CameraFaultKind::packets_doubled, "packets_doubled"},
    {CameraFaultKind::frozen, "frozen"},
    {CameraFaultKind::rebooted, "rebooted"},
    {CameraFaultKind::privilege_stolen, "privilege_stolen"},
    {CameraFaultKind::wrong_exposure, "wrong_exposure"},
    {CameraFaultKind::stale_frame, "stale_frame"},
    {CameraFaultKind::wrong_size, "wrong_size"},
}};

}  // namespace

std::string_view name_of(CameraFaultKind kind) {
  for (const auto& [known, name] : names)
    if (known == kind) return name;
  return "unknown";
}

std::optional<CameraFaultKind> camera_fault_kind(std::string_view name) {
  for (const auto& [kind, known] : names)
    if (known == name) return kind;
  return std::nullopt;
}

void CameraWireFaults::add(const CameraFault& fault) {
  const std::lock_guard lock(mutex_);
  faults_.push_back(fault);
}

void CameraWireFaults::add_next(CameraFaultKind kind, double seconds) {
  const std::lock_guard lock(mutex_);
  faults_.push_back({kind, frames_ + 1, seconds});
}

void CameraWireFaults::lose(double share, bool resend, std::uint64_t seed) {
  const std::lock_guard lock(mutex_);
  share_ = share;
  resend_ = resend;
  seed_ = seed;
}

void CameraWireFaults::number_anew_from_every_start() {
  const std::lock_guard lock(mutex_);
  numbers_anew_ = true;
}

void CameraWireFaults::hold_gamma() {
  const std::lock_guard lock(mutex_);
  holds_gamma_ = true;
}

bool CameraWireFaults::holds_gamma() const {
  const std::lock_guard lock(mutex_);
  return holds_gamma_;
}

void CameraWireFaults::keep_settings() {
  const std::lock_guard lock(mutex_);
  keeps_settings_ = true;
}

bool CameraWireFaults::keeps_settings() const {
  const std::lock_guard lock(mutex_);
  return keeps_settings_;
}

bool CameraWireFaults::numbers_anew() const {
  const std::lock_guard lock(mutex_);
  return numbers_anew_;
}

std::vector<CameraFault> CameraWireFaults::begin_frame() {
  const std::lock_guard lock(mutex_);
  ++frames_;
  std::vector<CameraFault> now;
  for (const CameraFault& fault : faults_)
    if (fault.nth_frame == frames_) now.push_back(fault);
  struck_.insert(struck_.end(), now.begin(), now.end());
  return now;
}

bool CameraWireFaults::loses_packet() {
  const std::lock_guard lock(mutex_);
  if (share_ <= 0) return false;
  ++packets_;
  const PhiloxCounter bits = philox(
      {static_cast<std::uint32_t>(packets_), static_cast<std::uint32_t>(packets_ >> 32), 0, 0},
      {static_cast<std::uint32_t>(seed_), static_cast<std::uint32_t>(seed_ >> 32)});
  const bool lost = uniform_open(bits[0], bits[1]) < share_;
  packets_lost_ += lost ? 1 : 0;
  return lost;
}

bool CameraWireFaults::resends() const {
  const std::lock_guard lock(mutex_);
  return resend_;
}

std::uint64_t CameraWireFaults::frames() const {
  const std::lock_guard lock(mutex_);
  return frames_;
}

std::vector<CameraFault> CameraWireFaults::struck() const {
  const std::lock_guard lock(mutex_);
  return struck_;
}

std::uint64_t CameraWireFaults::packets_lost() const {
  const std::lock_guard lock(mutex_);
  return packets_lost_;
}

}  // namespace lightrig::sim
