#include "config/descriptions.h"

namespace lightrig {

std::vector<KeySpec> serial_keys() {
  const Condition serial{"device", {}};
  return {
      {.name = "baud",
       .kind = ValueKind::integer,
       .range = {300, 4000000},
       .need = Need::optional,
       .when = serial,
       .doc = "Speed of the line; absent: the profile's, else 115200."},
      {.name = "parity",
       .kind = ValueKind::choice,
       .need = Need::optional,
       .choices = {"none", "even", "odd"},
       .when = serial,
       .doc = "Absent: the profile's, else \"none\"."},
      {.name = "data_bits",
       .kind = ValueKind::integer,
       .range = {7, 8},
       .need = Need::optional,
       .when = serial,
       .doc = "Absent: the profile's, else 8."},
      {.name = "stop_bits",
       .kind = ValueKind::integer,
       .range = {1, 2},
       .need = Need::optional,
       .when = serial,
       .doc = "Absent: the profile's, else 1."},
      {.name = "rs485",
       .kind = ValueKind::boolean,
       .need = Need::optional,
       .when = serial,
       .doc = "Ask the port's driver to switch an RS-485 transceiver's direction; absent: false."},
  };
}

KeySpec timeout_key(const char* fallback) {
  return {.name = "timeout_ms",
          .kind = ValueKind::integer,
          .unit = units::ms,
          .range = {1, 60000},
          .need = Need::defaulted,
          .fallback = fallback,
          .doc = "Longest wait for one answer."};
}

std::vector<KeySpec> endpoint_keys() {
  std::vector<KeySpec> keys = {
      {.name = "host",
       .kind = ValueKind::text,
       .need = Need::optional,
       .doc = "Modbus TCP: name or address."},
      {.name = "port",
       .kind = ValueKind::integer,
       .range = {1, 65535},
       .need = Need::defaulted,
       .fallback = "502",
       .when = Condition{"host", {}},
       .doc = "Modbus TCP: port."},
      {.name = "device",
       .kind = ValueKind::text,
       .need = Need::optional,
       .doc = "Modbus RTU: serial port, such as \"/dev/serial/by-id/…\"."},
  };
  for (KeySpec& key : serial_keys()) keys.push_back(std::move(key));
  return keys;
}

namespace {

TableSpec modbus_table() {
  TableSpec drive{.name = "drive",
                  .repeat = Repeat::list,
                  .doc = "One drive and the axis it moves; one per axis."};
  drive.keys = {
      {.name = "axis",
       .kind = ValueKind::choice,
       .choices = axis_names(),
       .doc = "The axis it moves."},
      {.name = "unit",
       .kind = ValueKind::integer,
       .range = {1, 247},
       .doc = "Modbus unit (slave) number of the drive."},
      {.name = "counts_per_rev",
       .range = {0, 1e9, true},
       .need = Need::optional,
       .doc = "Counts per turn of the motor; needed where the profile gives speeds in rpm."},
  };
  for (KeySpec& key :
       both_units("axis",
                  {.name = "counts_per_deg",
                  .unit = units::per_deg,
                  .range = {-1e9, 1e9},
                  .doc = "Drive counts per degree (per millimetre) of the axis, gears included; "
                         "negative turns the sense.",
                  .why = "it decides where the lamp goes"},
                  "counts_per_mm", units::per_mm, {-1e9, 1e9}))
    drive.keys.push_back(std::move(key));
  for (KeySpec& key : both_units("axis",
                                 {.name = "zero_deg",
                                 .unit = units::deg,
                                 .range = {-720, 720},
                                 .need = Need::defaulted,
                                 .fallback = "0",
                                 .doc = "Position of the axis where the drive says 0 counts."},
                                 "zero_mm", units::mm, {-1e5, 1e5}))
    drive.keys.push_back(std::move(key));
  for (KeySpec& key : endpoint_keys()) drive.keys.push_back(std::move(key));
  drive.exactly_one = {{"host", "device"}};
  TableSpec t{.name = "modbus",
              .when = Condition{"backend", {"modbus"}},
              .doc = "Drives that speak Modbus as a controller profile describes."};
  t.keys = {
      {.name = "profile",
       .kind = ValueKind::path,
       .doc = "Controller profile; see docs/controller_profile.md."},
      timeout_key("500"),
  };
  t.tables = {drive};
  return t;
}

TableSpec grbl_table() {
  TableSpec axis{.name = "axis",
                 .repeat = Repeat::list,
                 .doc = "How an axis is named and scaled in G-code; one per axis."};
  axis.keys = {
      {.name = "axis", .kind = ValueKind::choice, .choices = axis_names(), .doc = "The axis."},
      {.name = "letter",
       .kind = ValueKind::choice,
       .choices = {"X", "Y", "Z", "A", "B", "C"},
       .doc = "Its letter in G-code."},
  };
  for (KeySpec& key :
       both_units("axis",
                  {.name = "units_per_deg",
                  .unit = units::per_deg,
                  .range = {-1e6, 1e6},
                  .doc = "GRBL's millimetres (or degrees) per degree (per millimetre) of the axis; "
                         "negative turns the sense."},
                  "units_per_mm", units::per_mm, {-1e6, 1e6}))
    axis.keys.push_back(std::move(key));
  TableSpec t{.name = "grbl",
              .when = Condition{"backend", {"grbl"}},
              .doc = "A GRBL 1.1 or grblHAL controller, over USB or a serial port."};
  t.keys = grbl_endpoint_keys();
  t.keys.push_back(timeout_key("1000"));
  t.exactly_one = {{"usb_vendor", "device"}};
  t.tables = {axis};
  return t;
}

}  // namespace

std::vector<KeySpec> grbl_endpoint_keys() {
  return {
      {.name = "usb_vendor",
       .kind = ValueKind::integer,
       .range = {0, 0xffff},
       .need = Need::optional,
       .doc = "USB vendor id, such as 0x2341: opens the device through libusb."},
      {.name = "usb_product",
       .kind = ValueKind::integer,
       .range = {0, 0xffff},
       .when = Condition{"usb_vendor", {}},
       .doc = "USB product id."},
      {.name = "usb_serial",
       .kind = ValueKind::text,
       .need = Need::defaulted,
       .fallback = "\"\"",
       .when = Condition{"usb_vendor", {}},
       .doc = "USB serial number; \"\" takes the only such device, and refuses several."},
      {.name = "device",
       .kind = ValueKind::text,
       .need = Need::optional,
       .doc = "Serial port, such as \"/dev/serial/by-id/…\"."},
      {.name = "baud",
       .kind = ValueKind::integer,
       .range = {300, 4000000},
       .need = Need::defaulted,
       .fallback = "115200",
       .doc = "Speed of the line."},
  };
}

namespace {

/// Which geometry, and its measures.
std::vector<KeySpec> geometry_keys() {
  return {
      {.name = "kinematics",
       .kind = ValueKind::choice,
       .choices = {"dome", "cartesian", "cartesian_aimed", "turntable", "lamps"},
       .doc =
           "\"dome\": position = centre + radius (cos e cos a, cos e sin a, sin e), lamp aimed at "
           "the centre. \"cartesian\": position = origin + (x, y, z), lamp in a fixed direction; "
           "\"cartesian_aimed\": a head of pan and tilt on it, aimed at the centre. "
           "\"turntable\": the object turns about the vertical through the centre, "
           "counter-clockwise "
           "seen from above; camera and lamp stand, or the lamp's elevation moves. \"lamps\": "
           "fixed "
           "lamps switched one at a time; nothing moves."},
      {.name = "centre_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e3, 1e3},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0]",
       .when = Condition{"kinematics", {"dome", "cartesian_aimed", "turntable", "lamps"}},
       .doc = "Centre of the dome or of the table; what lamps are aimed at."},
      {.name = "radius_m",
       .unit = units::m,
       .range = {0, 100, true},
       .when = Condition{"kinematics", {"dome", "turntable"}},
       .doc = "Distance of the lamp's emitting centre from the centre."},
      {.name = "origin_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e3, 1e3},
       .when = Condition{"kinematics", {"cartesian", "cartesian_aimed"}},
       .doc = "Where the lamp's emitting centre is at x = y = z = 0."},
      {.name = "lamp_direction",
       .kind = ValueKind::vector3,
       .range = {-1e4, 1e4},
       .need = Need::defaulted,
       .fallback = "[0, 0, -1]",
       .when = Condition{"kinematics", {"cartesian"}},
       .doc = "Where the lamp's axis points."},
      {.name = "lamp_azimuth_deg",
       .unit = units::deg,
       .range = {-360, 360},
       .when = Condition{"kinematics", {"turntable"}},
       .doc = "Azimuth of the lamp, from x towards y."},
      {.name = "lamp_elevation_deg",
       .unit = units::deg,
       .range = {-90, 90},
       .need = Need::optional,
       .when = Condition{"kinematics", {"turntable"}},
       .doc = "Elevation of the lamp; needed where it has no axis \"elevation\"."},
      {.name = "lamps_m",
       .kind = ValueKind::vectors,
       .unit = units::m,
       .range = {-1e3, 1e3},
       .when = Condition{"kinematics", {"lamps"}},
       .doc = "Emitting centres of the fixed lamps, in the order of their switches."},
  };
}

/// When a move has arrived, and when an exposure may begin.
std::vector<KeySpec> arrival_keys() {
  return {
      {.name = "settle_s",
       .unit = units::s,
       .range = {0, 600},
       .doc = "At rest for so long before an exposure.",
       .why = "it depends on how long the arm swings"},
      {.name = "tolerance_deg",
       .unit = units::deg,
       .range = {0, 10, true},
       .when = Condition{"kinematics", {"dome", "cartesian_aimed", "turntable"}},
       .doc = "A move has arrived when every rotary axis is within this of its target.",
       .why = "it decides which frames are believed"},
      {.name = "tolerance_mm",
       .unit = units::mm,
       .range = {0, 100, true},
       .when = Condition{"kinematics", {"cartesian", "cartesian_aimed"}},
       .doc = "And every linear axis within this.",
       .why = "it decides which frames are believed"},
  };
}

/// How long motions may take.
std::vector<KeySpec> time_keys() {
  return {
      {.name = "move_time_factor",
       .range = {1, 100},
       .need = Need::defaulted,
       .fallback = "1.5",
       .doc = "A move fails after its predicted time times this, plus the margin."},
      {.name = "move_time_margin_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {0, 600000},
       .need = Need::defaulted,
       .fallback = "2000",
       .doc = "The margin."},
      {.name = "homing_timeout_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {1, 3600000},
       .need = Need::defaulted,
       .fallback = "60000",
       .doc = "Homing fails after this long."},
  };
}

KeySpec backend_key() {
  return {.name = "backend",
          .kind = ValueKind::choice,
          .choices = {"modbus", "grbl", "lamps", "simulated"},
          .doc =
              "How the gantry is reached. \"lamps\": there is none to reach, fixed lamps hang on "
              "the coils of [lamp.modbus]. \"simulated\" exists only under --simulate."};
}

}  // namespace

TableSpec gantry_table() {
  TableSpec t{.name = "gantry",
              .doc = "What carries the lamp: its geometry, its limits, and how it is reached."};
  for (const auto& keys : {geometry_keys(), arrival_keys(), time_keys()})
    t.keys.insert(t.keys.end(), keys.begin(), keys.end());
  t.keys.push_back(backend_key());
  t.tables = {axis_table(), body_table(), modbus_table(), grbl_table()};
  return t;
}

}  // namespace lightrig
