#include "config/controller_profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "config/check_profile.h"
#include "config/descriptions.h"
#include "config/documents.h"

namespace lightrig {
namespace {

RegisterTable table_of(const std::string& name) {
  return name == "coil"       ? RegisterTable::coil
         : name == "discrete" ? RegisterTable::discrete
         : name == "holding"  ? RegisterTable::holding
                              : RegisterTable::input;
}

WordOrder order_of(const std::string& name) {
  return name == "low_first" ? WordOrder::low_first : WordOrder::high_first;
}

RegisterItem make_item(const Section& s, WordOrder usual) {
  RegisterItem item;
  const std::string& type = s.text("type");
  item.table = table_of(s.text("table"));
  item.address = s.integer("address");
  item.type = type == "u16"   ? RawType::u16
              : type == "s16" ? RawType::s16
              : type == "u32" ? RawType::u32
                              : RawType::s32;
  item.order = s.has("word_order") ? order_of(s.text("word_order")) : usual;
  item.scale = s.number("scale");
  item.offset = s.number("offset");
  return item;
}

Quantity quantity_of(const std::string& name) {
  return name == "position"       ? Quantity::position
         : name == "speed"        ? Quantity::speed
         : name == "acceleration" ? Quantity::acceleration
         : name == "deceleration" ? Quantity::deceleration
                                  : Quantity::constant;
}

RawUnit unit_of(const Section& write, Quantity quantity) {
  if (quantity == Quantity::constant) return RawUnit::none;
  if (write.has("unit")) {
    const std::string& name = write.text("unit");
    return name == "counts"          ? RawUnit::counts
           : name == "counts_per_s"  ? RawUnit::counts_per_s
           : name == "rpm"           ? RawUnit::rpm
           : name == "counts_per_s2" ? RawUnit::counts_per_s2
                                     : RawUnit::ms_per_1000_rpm;
  }
  if (quantity == Quantity::position) return RawUnit::counts;
  return quantity == Quantity::speed ? RawUnit::counts_per_s : RawUnit::counts_per_s2;
}

Trigger make_trigger(const Section& s) {
  Trigger t;
  const std::string& style = s.text("style");
  if (style == "implicit") return t;
  t.style = style == "value"         ? TriggerStyle::value
            : style == "level_clear" ? TriggerStyle::level_clear
                                     : TriggerStyle::edge;
  t.table = table_of(s.text("table"));
  t.address = s.integer("address");
  t.set = s.integer("set");
  if (t.style == TriggerStyle::value) return t;
  t.clear = s.integer("clear");
  t.pulse = std::chrono::milliseconds(s.integer("pulse_ms"));
  return t;
}

ProfileCommand make_command(const Section& s, WordOrder usual) {
  ProfileCommand c;
  c.block = s.boolean("block");
  for (const Section* write : s.all("write")) {
    ProfileWrite w;
    w.item = make_item(*write, usual);
    w.quantity = quantity_of(write->text("quantity"));
    w.item.unit = unit_of(*write, w.quantity);
    if (w.quantity == Quantity::constant) w.constant = write->whole("value");
    c.writes.push_back(w);
  }
  c.trigger = make_trigger(s.table("trigger"));
  return c;
}

StatusBit make_bit(const Section& s) {
  StatusBit bit;
  bit.table = table_of(s.text("table"));
  bit.address = s.integer("address");
  bit.mask = s.integer("mask");
  bit.value = s.has("value") ? s.integer("value") : bit.mask;
  return bit;
}

template <class T, class Make>
std::optional<T> optional_of(const Section& root, const char* name, Make make) {
  const Section* s = root.find(name);
  return s == nullptr ? std::nullopt : std::optional<T>(make(*s));
}

void set_facts(const Section& root, ControllerProfile& p) {
  const Section& c = root.table("controller");
  p.name = c.text("name");
  p.source = c.text("source");
  p.unverified = c.text("unverified");
  const auto& transports = c.texts("transports");
  p.tcp = std::ranges::find(transports, "tcp") != transports.end();
  p.rtu = std::ranges::find(transports, "rtu") != transports.end();
  p.frame_gap = std::chrono::milliseconds(c.integer("frame_gap_ms"));
  p.max_block = c.integer("max_block_registers");
  if (const Section* s = root.find("serial")) {
    const std::string& parity = s->text("parity");
    p.serial = {s->integer("baud"),
                parity == "even"  ? 'E'
                : parity == "odd" ? 'O'
                                  : 'N',
                s->integer("data_bits"), s->integer("stop_bits")};
  }
  const Section& limits = root.table("limits");
  if (limits.has("max_speed_counts_per_s"))
    p.limits.max_speed = limits.number("max_speed_counts_per_s");
  if (limits.has("min_position_counts"))
    p.limits.min_position = limits.whole("min_position_counts");
  if (limits.has("max_position_counts"))
    p.limits.max_position = limits.whole("max_position_counts");
}

void set_status(const Section& root, ControllerProfile& p) {
  const Section& s = root.table("status");
  p.ready = optional_of<StatusBit>(s, "ready", make_bit);
  p.moving = optional_of<StatusBit>(s, "moving", make_bit);
  p.in_position = optional_of<StatusBit>(s, "in_position", make_bit);
  p.homed = optional_of<StatusBit>(s, "homed", make_bit);
  p.alarm = optional_of<StatusBit>(s, "alarm", make_bit);
  p.enabled = optional_of<StatusBit>(s, "enabled", make_bit);
  p.e_stop = optional_of<StatusBit>(s, "e_stop", make_bit);
  const Section& done = root.table("done");
  p.done = {done.boolean("must_see_busy"),
            std::chrono::milliseconds(done.integer("minimum_delay_ms"))};
}

ControllerProfile make_profile(const Section& root) {
  ControllerProfile p;
  set_facts(root, p);
  set_status(root, p);
  const WordOrder usual = order_of(root.table("controller").text("word_order"));
  const auto command = [&](const Section& s) { return make_command(s, usual); };
  p.move = command(root.table("move"));
  p.home = command(root.table("home"));
  p.stop = command(root.table("stop"));
  p.enable = optional_of<ProfileCommand>(root, "enable", command);
  p.reset_alarm = optional_of<ProfileCommand>(root, "reset_alarm", command);
  p.position = make_item(root.table("position"), usual);
  p.position.unit = RawUnit::counts;
  if (const Section* s = root.find("known"))
    p.known = ControllerProfile::Known{make_item(*s, usual), s->whole("value")};
  if (const Section* s = root.find("alarm_code")) p.alarm_code = make_item(*s, usual);
  if (const Section* s = root.find("alarms"))
    for (const auto& [code, text] : s->free_form) p.alarm_texts[*alarm_number(code)] = text;
  if (const Section* s = root.find("watchdog"))
    p.watchdog =
        DriveWatchdog{make_item(*s, usual), std::chrono::milliseconds(s->integer("timeout_ms"))};
  for (const Section* s : root.all("outputs"))
    p.outputs[s->name] = {table_of(s->text("table")), s->integer("address"), s->integer("off"),
                          s->integer("on"), s->boolean("dimmable")};
  for (const Section* s : root.all("inputs")) p.inputs[s->name] = make_bit(*s);
  return p;
}

}  // namespace

ReadProfile read_profile_text(std::string text, const std::filesystem::path& path) {
  ReadProfile read;
  read.text = std::move(text);
  const Source source{path, read.text};
  Findings findings;
  const auto root = read_document(source, profile_description(),
                                  "at least [controller], [move], [home], [stop], [position], "
                                  "[status] and [done]",
                                  findings);
  if (root) {
    check_profile(*root, findings);
    if (!findings.has_error()) read.value = make_profile(*root);
  }
  read.diagnostics = findings.sorted();
  return read;
}

ReadProfile read_profile(const std::filesystem::path& path) {
  auto text = read_text(path);
  if (!text) return {std::nullopt, {text.error()}, {}};
  return read_profile_text(std::move(*text), path);
}

}  // namespace lightrig
