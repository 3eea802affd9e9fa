#include "config/descriptions.h"

namespace lightrig {
namespace {

const std::vector<std::string> any_table = {"coil", "discrete", "holding", "input"};
const std::vector<std::string> writable = {"coil", "holding"};

KeySpec address_key() {
  return {.name = "address",
          .kind = ValueKind::integer,
          .range = {0, 65535},
          .doc = "Register address as on the wire: 0x0058, not 40089."};
}
KeySpec table_key(const std::vector<std::string>& tables) {
  return {.name = "table",
          .kind = ValueKind::choice,
          .need = Need::defaulted,
          .fallback = "\"holding\"",
          .choices = tables,
          .doc =
              "Modbus table, and with it the function codes: coil 01/05/0F, discrete 02, holding "
              "03/06/10, input 04."};
}

std::vector<KeySpec> item_keys(const std::vector<std::string>& tables) {
  return {
      table_key(tables),
      address_key(),
      {.name = "type",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"u16\"",
       .choices = {"u16", "s16", "u32", "s32"},
       .doc = "32-bit types take the register at address and the next."},
      {.name = "word_order",
       .kind = ValueKind::choice,
       .need = Need::optional,
       .choices = {"high_first", "low_first"},
       .doc = "Order of the two registers of a 32-bit value; absent: the controller's."},
      {.name = "scale",
       .range = {-1e12, 1e12},
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "raw = value · scale + offset."},
      {.name = "offset",
       .range = {-1e12, 1e12},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "raw = value · scale + offset."},
  };
}

TableSpec trigger_table() {
  const Condition needs_address{"style", {"value", "level_clear", "edge"}};
  const Condition pulsed{"style", {"level_clear", "edge"}};
  TableSpec t{.name = "trigger", .need = Need::defaulted, .doc = "What sets the command off."};
  t.keys = {
      {.name = "style",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"implicit\"",
       .choices = {"implicit", "value", "level_clear", "edge"},
       .doc = "\"implicit\": the last write does. \"value\": set is written and left. "
              "\"level_clear\": set, held for pulse_ms, then clear. \"edge\": clear, set, held for "
              "pulse_ms, clear."},
      {.name = "table",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"holding\"",
       .choices = writable,
       .when = needs_address,
       .doc = "Modbus table of the trigger."},
      {.name = "address",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .when = needs_address,
       .doc = "Address of the trigger."},
      {.name = "set",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .when = needs_address,
       .doc = "What sets it off."},
      {.name = "clear",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::defaulted,
       .fallback = "0",
       .when = pulsed,
       .doc = "What it rests at."},
      {.name = "pulse_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {1, 10000},
       .when = pulsed,
       .doc = "How long set is held; longer than the controller's scan."},
  };
  return t;
}

TableSpec command_table(const char* name, Need need, const char* doc) {
  TableSpec write{.name = "write",
                  .repeat = Repeat::list,
                  .need = Need::optional,
                  .doc = "One write, in order."};
  write.keys = item_keys(writable);
  const std::vector<KeySpec> own = {
      {.name = "quantity",
       .kind = ValueKind::choice,
       .choices = {"constant", "position", "speed", "acceleration", "deceleration"},
       .doc = "What it carries."},
      {.name = "unit",
       .kind = ValueKind::choice,
       .need = Need::optional,
       .choices = {"counts", "counts_per_s", "rpm", "counts_per_s2", "ms_per_1000_rpm"},
       .when = Condition{"quantity", {"position", "speed", "acceleration", "deceleration"}},
       .doc = "Unit before scale and offset; absent: counts, counts_per_s, counts_per_s2."},
      {.name = "value",
       .kind = ValueKind::integer,
       .range = {-2147483648.0, 4294967295.0},
       .when = Condition{"quantity", {"constant"}},
       .doc = "The raw constant."},
  };
  write.keys.insert(write.keys.end(), own.begin(), own.end());
  TableSpec t{.name = name, .need = need, .doc = doc};
  t.keys = {{.name = "block",
             .kind = ValueKind::boolean,
             .need = Need::defaulted,
             .fallback = "false",
             .doc = "All writes go out as one FC10 over consecutive holding registers."}};
  t.tables = {write, trigger_table()};
  return t;
}

TableSpec bit_table(const char* name, const char* doc) {
  TableSpec t{.name = name, .need = Need::optional, .doc = doc};
  t.keys = {
      table_key(any_table),
      address_key(),
      {.name = "mask",
       .kind = ValueKind::integer,
       .range = {1, 65535},
       .doc = "The bits looked at."},
      {.name = "value",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::optional,
       .doc = "True when (register & mask) == value; absent: the mask itself."},
  };
  return t;
}

TableSpec status_table() {
  TableSpec t{.name = "status", .doc = "Where the drive says how it is."};
  t.tables = {
      bit_table("ready", "Takes a command: no motion begins before the drive says so."),
      bit_table("moving", "In motion."),
      bit_table("in_position",
                "At the commanded position: no move ends before. Without [status.moving] the drive "
                "counts as moving while it is not."),
      bit_table("homed", "Knows where it is."),
      bit_table("alarm", "Has stopped with a fault."),
      bit_table("enabled", "Holds its motor: no motion begins before the drive says so."),
      bit_table("e_stop", "The emergency stop chain is open."),
  };
  return t;
}

TableSpec item_table(const char* name, Need need, const char* doc,
                     const std::vector<std::string>& tables) {
  TableSpec t{.name = name, .need = need, .doc = doc};
  t.keys = item_keys(tables);
  return t;
}

TableSpec controller_table() {
  TableSpec t{.name = "controller", .doc = "The product, and how far this profile can be trusted."};
  t.keys = {
      {.name = "name", .kind = ValueKind::text, .doc = "Maker and series."},
      {.name = "source",
       .kind = ValueKind::text,
       .doc = "Manuals (with number and edition) or code the registers were taken from."},
      {.name = "unverified",
       .kind = ValueKind::text,
       .doc = "What nobody has yet seen on the hardware; \"\" when all has been."},
      {.name = "transports", .kind = ValueKind::texts, .doc = "\"tcp\", \"rtu\", or both."},
      {.name = "word_order",
       .kind = ValueKind::choice,
       .choices = {"high_first", "low_first"},
       .doc = "Order of the two registers of a 32-bit value."},
      {.name = "frame_gap_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {0, 1000},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Silence that the controller wants between its answer and the next request."},
      {.name = "max_block_registers",
       .kind = ValueKind::integer,
       .range = {1, 123},
       .need = Need::defaulted,
       .fallback = "123",
       .doc = "Most registers in one request."},
  };
  return t;
}

TableSpec serial_table() {
  TableSpec t{
      .name = "serial",
      .need = Need::optional,
      .doc =
          "The serial line as the controller leaves its factory; the rig file may say otherwise."};
  t.keys = {
      {.name = "baud", .kind = ValueKind::integer, .range = {300, 4000000}, .doc = "Speed."},
      {.name = "parity",
       .kind = ValueKind::choice,
       .choices = {"none", "even", "odd"},
       .doc = "Parity."},
      {.name = "data_bits",
       .kind = ValueKind::integer,
       .range = {7, 8},
       .need = Need::defaulted,
       .fallback = "8",
       .doc = "Data bits."},
      {.name = "stop_bits",
       .kind = ValueKind::integer,
       .range = {1, 2},
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "Stop bits."},
  };
  return t;
}

TableSpec done_table() {
  TableSpec t{
      .name = "done",
      .doc = "When a move is over; always together with a position within tolerance and no alarm."};
  t.keys = {
      {.name = "must_see_busy",
       .kind = ValueKind::boolean,
       .doc =
           "The drive must have been seen moving (or minimum_delay_ms have passed) before its done "
           "bit is believed; needs [status.moving]."},
      {.name = "minimum_delay_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {1, 10000},
       .doc = "Before this the done bit may still be the previous move's."},
  };
  return t;
}

TableSpec watchdog_table() {
  TableSpec t{.name = "watchdog",
              .need = Need::optional,
              .doc =
                  "The drive stops by itself when it hears nothing for so long; written at opening "
                  "and read back."};
  t.keys = item_keys({"holding"});
  t.keys.push_back({.name = "timeout_ms",
                    .kind = ValueKind::integer,
                    .unit = units::ms,
                    .range = {10, 60000},
                    .doc = "The time; the register holds it in seconds · scale + offset."});
  return t;
}

TableSpec limits_table() {
  TableSpec t{.name = "limits",
              .need = Need::defaulted,
              .doc = "What the controller accepts; a rig that asks for more is refused."};
  t.keys = {
      {.name = "max_speed_counts_per_s",
       .range = positive,
       .need = Need::optional,
       .doc = "Greatest speed."},
      {.name = "min_position_counts",
       .kind = ValueKind::integer,
       .range = {-2147483648.0, 2147483647.0},
       .need = Need::optional,
       .doc = "Least position."},
      {.name = "max_position_counts",
       .kind = ValueKind::integer,
       .range = {-2147483648.0, 2147483647.0},
       .need = Need::optional,
       .doc = "Greatest position."},
  };
  return t;
}

TableSpec outputs_table() {
  TableSpec t{.name = "outputs",
              .repeat = Repeat::named,
              .need = Need::optional,
              .doc = "An output, such as [outputs.lamp]; a rig names it in [lamp.gantry]."};
  t.keys = {
      {.name = "table", .kind = ValueKind::choice, .choices = writable, .doc = "Modbus table."},
      address_key(),
      {.name = "off",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Written for off."},
      {.name = "on",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::defaulted,
       .fallback = "1",
       .doc = "Written for full power."},
      {.name = "dimmable",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .doc = "Values between off and on are powers between 0 and 1."},
  };
  return t;
}

TableSpec describe_profile() {
  TableSpec known =
      item_table("known", Need::optional,
                 "A register with a known answer, to prove that a line is in step.", any_table);
  known.keys.push_back({.name = "value",
                        .kind = ValueKind::integer,
                        .range = {-2147483648.0, 4294967295.0},
                        .doc = "The raw answer."});
  TableSpec inputs = bit_table(
      "inputs", "An input, such as [inputs.door]: true when closed, so that motion is allowed.");
  inputs.repeat = Repeat::named;
  TableSpec root{.name = "", .doc = "A controller profile."};
  root.tables = {
      controller_table(),
      serial_table(),
      command_table("move", Need::required, "A move to an absolute position."),
      command_table("home", Need::required, "The drive's own homing."),
      command_table("stop", Need::required, "Decelerate and hold."),
      command_table("enable", Need::optional,
                    "Make the drive hold its motor; sent before homing. None lets it go: an axis "
                    "without a brake would fall."),
      command_table("reset_alarm", Need::optional, "Clear a fault."),
      item_table("position", Need::required, "Where the drive is, in counts.",
                 {"holding", "input"}),
      known,
      status_table(),
      done_table(),
      item_table("alarm_code", Need::optional, "Which fault it is.", {"holding", "input"}),
      {.name = "alarms",
       .need = Need::optional,
       .doc = "Code and text, such as `0x30 = \"Overload\"`.",
       .free_form = true},
      watchdog_table(),
      limits_table(),
      outputs_table(),
      inputs,
  };
  return root;
}

}  // namespace

const TableSpec& profile_description() {
  static const TableSpec description = describe_profile();
  return description;
}

}  // namespace lightrig
