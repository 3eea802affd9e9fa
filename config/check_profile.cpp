#include "config/check_profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace lightrig {
namespace {

bool is_one_bit(const std::string& table) { return table == "coil" || table == "discrete"; }

int registers_of(const Section& item) {
  return item.has("type") && item.text("type").ends_with("32") ? 2 : 1;
}

void check_item(const Section& s, Findings& findings) {
  if (s.has("scale") && s.number("scale") == 0)
    findings.error(s.at("scale"), s.path + ".scale is 0; every value would be the same");
  if (s.has("table") && is_one_bit(s.text("table")) && s.has("type") && s.text("type") != "u16")
    findings.error(s.at("type"), fmt::format("{}.type is \"{}\", but a {} holds one bit", s.path,
                                             s.text("type"), s.text("table")));
  if (s.has("address") && s.integer("address") + registers_of(s) > 65536)
    findings.error(s.at("address"), s.path + ": the second register lies beyond 65535");
}

void check_fits(const Section& s, const std::string& key, Findings& findings) {
  if (!s.has(key) || !s.has("type")) return;
  const std::string& type = s.text("type");
  const std::int64_t value = s.whole(key);
  const std::int64_t least = type == "s16" ? -32768 : type == "s32" ? -2147483648LL : 0;
  const bool bit = s.has("table") && is_one_bit(s.text("table"));
  const std::int64_t most = bit             ? 1
                            : type == "u16" ? 65535
                            : type == "s16" ? 32767
                            : type == "u32" ? 4294967295LL
                                            : 2147483647;
  if (value < least || value > most)
    findings.error(s.at(key), fmt::format("{}.{} is {}; a {} holds {} … {}", s.path, key, value,
                                          bit ? "coil" : type, least, most));
}

void check_unit(const Section& write, Findings& findings) {
  if (!write.has("quantity") || !write.has("unit")) return;
  const std::string &quantity = write.text("quantity"), &unit = write.text("unit");
  const bool fits = quantity == "position" ? unit == "counts"
                    : quantity == "speed"  ? unit == "counts_per_s" || unit == "rpm"
                                           : unit == "counts_per_s2" || unit == "ms_per_1000_rpm";
  if (!fits)
    findings.error(write.at("unit"),
                   fmt::format("{}.unit: \"{}\" is no unit of {}", write.path, unit, quantity));
}

void check_block(const Section& command, const Section* controller, Findings& findings) {
  const std::vector<const Section*> writes = command.all("write");
  int next = -1, total = 0;
  for (const Section* w : writes) {
    if (!w->has("address") || !w->has("type") || !w->has("table")) return;
    if (w->text("table") != "holding")
      findings.error(w->at("table"), fmt::format("{}: a block is of holding registers", w->path));
    if (next >= 0 && w->integer("address") != next)
      findings.error(w->at("address"),
                     fmt::format("{}.address is 0x{:04X}; the block goes on at 0x{:04X}", w->path,
                                 w->integer("address"), next));
    next = w->integer("address") + registers_of(*w);
    total += registers_of(*w);
  }
  if (controller != nullptr && controller->has("max_block_registers") &&
      total > controller->integer("max_block_registers"))
    findings.error(command.at("block"),
                   fmt::format("[{}]: the block has {} registers; the controller takes {}",
                               command.path, total, controller->integer("max_block_registers")));
}

void check_trigger(const Section& command, Findings& findings) {
  const Section* t = command.find("trigger");
  if (t == nullptr || !t->has("style")) return;
  if (t->text("style") == "implicit") {
    if (command.all("write").empty())
      findings.error(command.place,
                     fmt::format("[{0}] does nothing: it has no [[{0}.write]] and its trigger is "
                                 "implicit",
                                 command.path));
    return;
  }
  if (t->has("set") && t->has("clear") && t->text("style") != "value" &&
      t->integer("set") == t->integer("clear"))
    findings.error(t->at("set"), t->path + ": set and clear are the same; there is no edge");
  if (!t->has("table") || t->text("table") != "coil") return;
  for (const char* key : {"set", "clear"})
    if (t->has(key) && t->integer(key) > 1)
      findings.error(t->at(key),
                     fmt::format("{}.{} is {}; a coil is 0 or 1", t->path, key, t->integer(key)));
}

void check_command(const Section& root, const char* name, Findings& findings) {
  const Section* command = root.find(name);
  if (command == nullptr) return;
  const bool is_move = command->path == "move";
  int positions = 0;
  for (const Section* w : command->all("write")) {
    check_item(*w, findings);
    check_unit(*w, findings);
    check_fits(*w, "value", findings);
    if (!w->has("quantity") || w->text("quantity") == "constant") continue;
    if (w->text("quantity") == "position") ++positions;
    if (!is_move)
      findings.error(w->at("quantity"), fmt::format("[{}] carries no {}: only a move does",
                                                    command->path, w->text("quantity")));
  }
  if (is_move && positions != 1)
    findings.error(command->place, fmt::format("[move] has {} writes of the position; it must have "
                                               "one [[move.write]] with quantity = \"position\"",
                                               positions));
  if (command->has("block") && command->boolean("block"))
    check_block(*command, root.find("controller"), findings);
  check_trigger(*command, findings);
}

void check_bit(const Section& s, Findings& findings) {
  if (!s.has("mask")) return;
  const int mask = s.integer("mask");
  if (s.has("table") && is_one_bit(s.text("table")) && mask != 1)
    findings.error(s.at("mask"), fmt::format("{}.mask is {}; a {} has one bit: mask 1", s.path,
                                             mask, s.text("table")));
  if (s.has("value") && (s.integer("value") & ~mask) != 0)
    findings.error(s.at("value"),
                   fmt::format("{}.value 0x{:04X} has bits outside the mask 0x{:04X}: it can never "
                               "match",
                               s.path, s.integer("value"), mask));
}

void check_done(const Section& root, Findings& findings) {
  const Section *done = root.find("done"), *status = root.find("status");
  if (done == nullptr || status == nullptr) return;
  const bool moving = status->find("moving") != nullptr;
  if (done->has("must_see_busy") && done->boolean("must_see_busy") && !moving)
    findings.error(done->at("must_see_busy"),
                   "done.must_see_busy needs [status.moving]: where does the drive say that it "
                   "moves?");
  if (!moving && status->find("in_position") == nullptr)
    findings.error(status->place,
                   "[status] has neither [status.moving] nor [status.in_position]: the end of a "
                   "move could not be told");
}

void check_outputs(const Section& root, Findings& findings) {
  for (const Section* s : root.all("outputs")) {
    if (!s->has("on") || !s->has("off")) continue;
    if (s->integer("on") == s->integer("off"))
      findings.error(s->at("on"), fmt::format("[{}]: on and off are the same", s->path));
    if (s->has("table") && s->text("table") == "coil") {
      for (const char* key : {"on", "off"})
        if (s->integer(key) > 1)
          findings.error(s->at(key), fmt::format("{}.{} is {}; a coil is 0 or 1", s->path, key,
                                                 s->integer(key)));
      if (s->has("dimmable") && s->boolean("dimmable"))
        findings.error(s->at("dimmable"), fmt::format("[{}]: a coil cannot be dimmed", s->path));
    }
  }
}

void check_facts(const Section& root, Findings& findings) {
  if (const Section* c = root.find("controller"); c != nullptr && c->has("transports"))
    for (std::size_t i = 0; i < c->texts("transports").size(); ++i)
      if (const std::string& t = c->texts("transports")[i]; t != "tcp" && t != "rtu")
        findings.error(c->at("transports", i),
                       fmt::format("controller.transports[{}] is \"{}\"; it must be \"tcp\" or "
                                   "\"rtu\"",
                                   i + 1, t));
  if (const Section* alarms = root.find("alarms"))
    for (const auto& [code, text] : alarms->free_form)
      if (!alarm_number(code))
        findings.error(alarms->place,
                       fmt::format("[alarms]: \"{}\" is no code; write 0x30 or 48", code));
  const Section* limits = root.find("limits");
  if (limits != nullptr && limits->has("min_position_counts") &&
      limits->has("max_position_counts") &&
      limits->whole("min_position_counts") >= limits->whole("max_position_counts"))
    findings.error(limits->at("max_position_counts"),
                   "limits.max_position_counts must be greater than min_position_counts");
}

}  // namespace

std::optional<std::int64_t> alarm_number(const std::string& code) {
  const bool hex = code.starts_with("0x") || code.starts_with("0X");
  const char* begin = code.data() + (hex ? 2 : 0);
  const char* end = code.data() + code.size();
  std::int64_t number = 0;
  const auto [at, error] = std::from_chars(begin, end, number, hex ? 16 : 10);
  if (error != std::errc{} || at != end || begin == end) return std::nullopt;
  return number;
}

void check_profile(const Section& root, Findings& findings) {
  for (const char* name : {"move", "home", "stop", "enable", "reset_alarm"})
    check_command(root, name, findings);
  for (const char* name : {"position", "known", "alarm_code", "watchdog"})
    if (const Section* item = root.find(name)) check_item(*item, findings);
  if (const Section* known = root.find("known")) check_fits(*known, "value", findings);
  if (const Section* status = root.find("status"))
    for (const Section& bit : status->sections) check_bit(bit, findings);
  for (const Section* input : root.all("inputs")) check_bit(*input, findings);
  check_done(root, findings);
  check_outputs(root, findings);
  check_facts(root, findings);
}

}  // namespace lightrig
