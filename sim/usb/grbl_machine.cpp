#include "sim/usb/grbl_machine.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <optional>

namespace lightrig::sim {
namespace {

constexpr std::string_view machine_letters = "XYZABC";
constexpr const char* grbl_banner = "\r\nGrbl 1.1h ['$' for help]\r\n";
constexpr const char* hal_banner = "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n";
/// G54, as the last who worked here left it [unit].
constexpr std::array<double, 6> work_offset{5, -3, 2, 1.5, 0, 0};
constexpr double mm_per_inch = 25.4;
constexpr int reports_between_offsets_moving = 29, reports_between_offsets_idle = 9;
constexpr int machine_position_bit = 1;  // of $10
constexpr std::size_t most_queued = 15;  // GRBL's planner blocks

/// A word of a block, e.g..
struct Word {
  char letter;
  double value;
};

std::optional<std::vector<Word>> words_of(const std::string& text) {
  std::vector<Word> words;
  for (std::size_t i = 0; i < text.size();) {
    const char letter = text[i++];
    if (std::isalpha(static_cast<unsigned char>(letter)) == 0) return std::nullopt;
    double value = 0;
    const auto [end, error] = std::from_chars(text.data() + i, text.data() + text.size(), value);
    if (error != std::errc()) return std::nullopt;
    i = static_cast<std::size_t>(end - text.data());
    words.push_back({letter, value});
  }
  return words;
}

}  // namespace

GrblMachine::GrblMachine(const GrblGantry& backend, std::shared_ptr<World> world,
                         GrblFirmware firmware)
    : backend_(backend),
      world_(std::move(world)),
      moves_(!backend.letters.empty()),
      lit_(!moves_ || std::holds_alternative<GantryLamp>(world_->rig().lamp.backend)),
      firmware_(firmware),
      alarm_(moves_) {  // locked at start where homing is enabled
  settings_ = {{10, machine_position_bit}, {13, 0},    {20, 1}, {21, 0},
               {22, moves_ ? 1 : 0},       {30, 1000}, {31, 0}, {32, 0}};
  const GantryModel& model = world_->rig().gantry.model;
  for (std::size_t i = 0; i < backend_.letters.size(); ++i) {
    const auto axis = static_cast<int>(machine_letters.find(backend_.letters[i]));
    const double units = std::abs(backend_.units_per_si[i]);  // a sense is no speed
    settings_[110 + axis] = model.axes[i].max_speed * units * 60;
    settings_[120 + axis] = model.axes[i].max_acceleration * units;
    settings_[130 + axis] = (model.axes[i].max - model.axes[i].min) * units;
  }
}

// The controller's zero is where homing ends.
double GrblMachine::machine_units(std::size_t axis, double value) const {
  return (value - world_->rig().gantry.model.axes[axis].home) * backend_.units_per_si[axis];
}

std::string GrblMachine::receive(std::string_view bytes) {
  std::string said;
  for (const char byte : bytes) {
    if (byte == '?' || byte == '!' || byte == '~' || byte == 0x18) {
      said += realtime(byte);
    } else if (byte == '\n' && std::exchange(after_cr_, false) && firmware_ == GrblFirmware::hal) {
      continue;
    } else if (byte == '\n' || byte == '\r') {
      // Every line end is answered, an empty line too: to GRBL "\r\n" is two.
      after_cr_ = byte == '\r';
      unheeded_.push_back(std::exchange(pending_, {}));
      said += heed_lines();
    } else if (pending_.size() < 127) {
      pending_ += byte;
    }
  }
  return said;
}

std::string GrblMachine::heed_lines() {
  std::string said;
  while (!unheeded_.empty() && !silent_ && !suspended()) {
    const std::string next = std::move(unheeded_.front());
    unheeded_.pop_front();
    said += line(next);
  }
  return said;
}

void GrblMachine::darken() {
  lamp_on_ = false;
  if (lit_) (void)world_->switch_lamp(0);
}

/// A controller without axes rests, and no door is wired to it.
GantryStatus GrblMachine::axes() const {
  if (moves_) return world_->gantry_status();
  GantryStatus status;
  status.at_rest = true;
  return status;
}

void GrblMachine::switch_lamp() {
  if (!lit_) return;
  const double lit = dims_ ? spindle_ / settings_.at(30) : 1.0;
  lamp_refused_ = !world_->switch_lamp(lamp_on_ && !door_ ? lit : 0.0);
}

std::string GrblMachine::realtime(char byte) {
  if (byte == 0x18) return reset();
  if (silent_) return {};
  if (byte == '?') return report();
  const GantryStatus now = axes();
  if (byte == '!' && !homing_ && !alarm_ && !door_) {
    hold_ = true;  // at rest too
    resumable_ = resumable_ || !now.at_rest;
    if (moves_) world_->halt_gantry();
  }
  if (byte == '~' && suspended() && now.at_rest && now.open_interlocks.empty()) {
    hold_ = door_ = false;
    switch_lamp();
    if (std::exchange(resumable_, false))
      (void)world_->start_move(going_.to, speed_share(going_.to, going_.feed));
    return heed_lines();
  }
  return {};
}

// Opened, the door holds what moves and stops spindle and coolant; homing it makes fail instead.
void GrblMachine::look_at_door() {
  const GantryStatus now = axes();
  if (door_ || alarm_ || homing_ || now.open_interlocks.empty()) return;
  door_ = true;
  resumable_ = !now.at_rest;
  switch_lamp();
}

std::string GrblMachine::reset() {
  const bool in_motion = !axes().at_rest;
  pending_.clear();
  unheeded_.clear();
  queue_.clear();
  hold_ = resumable_ = silent_ = door_ = false;
  modal_ = {};
  sticky_error_ = reports_to_offset_ = 0;
  darken();
  std::string said;
  if (in_motion || homing_) {
    world_->lose_position();
    said = homing_ ? "ALARM:6\r\n" : "ALARM:3\r\n";
    alarm_ = true;
  }
  homing_ = false;
  said += firmware_ == GrblFirmware::hal ? hal_banner : grbl_banner;
  if (alarm_) said += "[MSG:'$H'|'$X' to unlock]\r\n";
  look_at_door();
  return said;
}

std::string GrblMachine::power_cycle() {
  if (moves_) world_->lose_position();
  (void)reset();
  alarm_ = moves_;
  homing_ = false;
  return std::string(firmware_ == GrblFirmware::hal ? hal_banner : grbl_banner) +
         (moves_ ? "[MSG:'$H'|'$X' to unlock]\r\n" : "");
}

// An alarm ends in a reset of motion, spindle and coolant [Grbl v1.1, mc_reset].
std::string GrblMachine::alarm(int number) {
  alarm_ = true;
  if (moves_) world_->halt_gantry();
  queue_.clear();
  darken();
  silent_ = number == 1 || number == 2;
  return fmt::format("ALARM:{}\r\n", number);
}

std::string GrblMachine::report() {
  const GantryStatus status = axes();
  std::string state = "Idle";
  if (homing_)
    state = "Home";
  else if (alarm_)
    state = "Alarm";
  else if (door_)
    state = !status.at_rest ? "Door:2" : status.open_interlocks.empty() ? "Door:0" : "Door:1";
  else if (hold_)
    state = status.at_rest ? "Hold:0" : "Hold:1";
  else if (!status.at_rest || !queue_.empty())
    state = "Run";
  std::vector<double> position(3, 0.0);
  for (std::size_t i = 0; i < backend_.letters.size(); ++i) {
    const std::size_t axis = machine_letters.find(backend_.letters[i]);
    if (axis >= position.size()) position.resize(axis + 1, 0.0);
    position[axis] = machine_units(i, status.position.axes[static_cast<Eigen::Index>(i)]);
  }
  const bool in_machine = (static_cast<int>(settings_.at(10)) & machine_position_bit) != 0;
  if (!in_machine)
    for (std::size_t i = 0; i < position.size(); ++i) position[i] -= work_offset.at(i);
  std::string text =
      fmt::format("<{}|{}:{:.3f}", state, in_machine ? "MPos" : "WPos", fmt::join(position, ","));
  text += fmt::format("|FS:{:.0f},{:.0f}", state == "Run" ? going_.feed : 0.0,
                      lamp_on_ && !door_ ? spindle_ : 0.0);
  if (!status.open_interlocks.empty()) text += "|Pn:D";
  if (reports_to_offset_-- == 0) {
    reports_to_offset_ =
        status.at_rest ? reports_between_offsets_idle : reports_between_offsets_moving;
    text += fmt::format("|WCO:{:.3f}",
                        fmt::join(work_offset.begin(), work_offset.begin() + position.size(), ","));
  }
  return text + ">\r\n";
}

std::string GrblMachine::settings() const {
  std::string said;
  for (const auto& [number, value] : settings_)
    said += fmt::format("${}={:.3f}\r\n", number, value);
  return said + "ok\r\n";
}

std::string GrblMachine::start_homing() {
  if (settings_.at(22) < 1) return "error:5\r\n";
  (void)world_->clear_fault();
  if (!world_->start_homing()) return "error:13\r\n";
  alarm_ = false;
  homing_ = true;  // its ok comes when it has ended
  return {};
}

std::string GrblMachine::tick() {
  look_at_door();
  const GantryStatus status = axes();
  if (!status.alarm.empty() && !alarm_)
    return alarm(status.alarm.starts_with("code ") ? std::atoi(status.alarm.c_str() + 5) : 1);
  if (homing_ && status.at_rest) {
    homing_ = false;
    if (!status.homed) return alarm(status.open_interlocks.empty() ? 9 : 7);
    return "ok\r\n";
  }
  if (!suspended() && !alarm_ && status.at_rest) start_next();
  return {};
}

void GrblMachine::start_next() {
  if (queue_.empty()) return;
  going_ = queue_.front();
  queue_.pop_front();
  (void)world_->start_move(going_.to, speed_share(going_.to, going_.feed));
}

// What a feed along the way is of the speed at which one of the axes would be at its limit.
double GrblMachine::speed_share(const GantryPosition& to, double feed) const {
  const AxisValues travel = to.axes - world_->gantry_status().position.axes;
  double seconds = 0, length_squared = 0;
  for (std::size_t i = 0; i < backend_.letters.size(); ++i) {
    const double way = travel[static_cast<Eigen::Index>(i)];
    seconds = std::max(seconds, std::abs(way) / world_->rig().gantry.model.axes[i].max_speed);
    length_squared += std::pow(way * backend_.units_per_si[i], 2);
  }
  if (!(feed > 0) || !(seconds > 0)) return 1;
  return std::clamp(feed / 60 * seconds / std::sqrt(length_squared), 1e-4, 1.0);
}

std::string GrblMachine::line(std::string text) {
  std::erase_if(text, [](unsigned char c) { return std::isspace(c) != 0; });
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  if (text.empty()) sticky_error_ = 0;
  if (sticky_error_ != 0) return fmt::format("error:{}\r\n", sticky_error_);
  std::string said = obey(text);
  if (firmware_ == GrblFirmware::hal && said.starts_with("error:"))
    sticky_error_ = std::atoi(said.c_str() + 6);
  return said;
}

std::string GrblMachine::obey(const std::string& text) {
  if (text.empty()) return "ok\r\n";
  if (text == "$$") return settings();
  if (text == "$H") return start_homing();
  if (text == "$X") {
    alarm_ = false;
    return "[MSG:Caution: Unlocked]\r\nok\r\n";
  }
  if (text.front() == '$') return set(text);
  if (alarm_) return "error:9\r\n";
  return block(text);
}

std::string GrblMachine::set(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) return "error:3\r\n";
  const auto known = settings_.find(std::atoi(text.c_str() + 1));
  if (known == settings_.end()) return "error:3\r\n";
  known->second = std::atof(text.c_str() + equals + 1);
  return "ok\r\n";
}

std::string GrblMachine::block(const std::string& text) {
  const auto words = words_of(text);
  if (!words) return "error:1\r\n";
  GantryPosition target{world_->gantry_status().position.axes};
  if (!queue_.empty()) target = queue_.back().to;
  bool moves = false, in_machine = false;
  // These take effect before motion and M, wherever they stand in the block.
  for (const Word& word : *words) {
    if (word.letter == 'S') spindle_ = word.value;
    if (word.letter == 'F') modal_.feed = word.value * (modal_.inches ? mm_per_inch : 1);
    if (word.letter != 'G') continue;
    if (word.value == 0 || word.value == 1)
      modal_.rapid = word.value == 0;
    else if (word.value == 20 || word.value == 21)
      modal_.inches = word.value == 20;
    else if (word.value == 90 || word.value == 91)
      modal_.absolute = word.value == 90;
    else if (word.value == 53)
      in_machine = true;
    else if (word.value != 54 && word.value != 94)
      return "error:20\r\n";
  }
  for (const Word& word : *words) {
    const auto axis = std::find(backend_.letters.begin(), backend_.letters.end(), word.letter);
    if (axis != backend_.letters.end()) {
      const auto i = static_cast<std::size_t>(axis - backend_.letters.begin());
      const auto row = static_cast<Eigen::Index>(i);
      double to = word.value * (modal_.inches ? mm_per_inch : 1);
      if (!in_machine)
        to += modal_.absolute ? work_offset.at(machine_letters.find(word.letter))
                              : machine_units(i, target.axes[row]);
      target.axes[row] = world_->rig().gantry.model.axes[i].home + to / backend_.units_per_si[i];
      moves = true;
    } else if (word.letter == 'M') {
      if (word.value == 3 || word.value == 7 || word.value == 8) lamp_on_ = true;
      if (word.value == 5 || word.value == 9) lamp_on_ = false;
      dims_ = word.value == 3;
      switch_lamp();
      if (lamp_refused_) return "error:33\r\n";
    } else if (word.letter != 'G' && word.letter != 'F' && word.letter != 'S') {
      return "error:20\r\n";
    }
  }
  if (!moves) return "ok\r\n";
  if (!modal_.rapid && !(modal_.feed > 0)) return "error:22\r\n";
  if (!within_limits(world_->rig().gantry.model, target)) return alarm(2);
  if (queue_.size() >= most_queued) return "error:24\r\n";
  queue_.push_back({target, modal_.rapid ? 0 : modal_.feed});
  if (world_->gantry_status().at_rest) start_next();
  return "ok\r\n";
}

}  // namespace lightrig::sim
