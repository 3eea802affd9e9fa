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

const std::vector<std::string> dome_axes = {"azimuth", "elevation"};

TableSpec axis_table() {
  TableSpec t{.name = "axis",
              .repeat = Repeat::list,
              .doc = "One motorised axis; a dome has \"azimuth\" and \"elevation\"."};
  t.keys = {
      {.name = "name",
       .kind = ValueKind::choice,
       .choices = dome_axes,
       .doc = "Which axis this is."},
      {.name = "min_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .doc = "Least position that any command may ask for.",
       .why = "a wrong limit breaks the rig"},
      {.name = "max_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .doc = "Greatest position that any command may ask for.",
       .why = "a wrong limit breaks the rig"},
      {.name = "max_speed_deg_per_s",
       .unit = units::deg_per_s,
       .range = {0, 3600, true},
       .doc = "Greatest speed of any move.",
       .why = "too fast a move can hurt people and the rig"},
      {.name = "max_acceleration_deg_per_s2",
       .unit = units::deg_per_s2,
       .range = {0, 36000, true},
       .doc = "Greatest acceleration of any move.",
       .why = "it depends on the mass that the axis carries"},
      {.name = "home_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .doc = "Position of the axis after homing.",
       .why = "it depends on where the switch sits"},
  };
  return t;
}

TableSpec modbus_table() {
  TableSpec drive{.name = "drive",
                  .repeat = Repeat::list,
                  .doc = "One drive and the axis it moves; one per axis."};
  drive.keys = {
      {.name = "axis",
       .kind = ValueKind::choice,
       .choices = dome_axes,
       .doc = "The axis it moves."},
      {.name = "unit",
       .kind = ValueKind::integer,
       .range = {1, 247},
       .doc = "Modbus unit (slave) number of the drive."},
      {.name = "counts_per_deg",
       .unit = units::per_deg,
       .range = {-1e9, 1e9},
       .doc = "Drive counts per degree of the axis, gears included; negative turns the sense.",
       .why = "it decides where the lamp goes"},
      {.name = "zero_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Position of the axis where the drive says 0 counts."},
      {.name = "counts_per_rev",
       .range = {0, 1e9, true},
       .need = Need::optional,
       .doc = "Counts per turn of the motor; needed where the profile gives speeds in rpm."},
  };
  for (KeySpec& key : endpoint_keys()) drive.keys.push_back(std::move(key));
  drive.exactly_one = {{"host", "device"}};
  TableSpec t{.name = "modbus",
              .when = Condition{"backend", {"modbus"}},
              .doc = "Drives that speak Modbus as a controller profile describes."};
  t.keys = {
      {.name = "profile",
       .kind = ValueKind::path,
       .doc = "Controller profile; see docs/controller_profile.md."},
      {.name = "timeout_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {1, 60000},
       .need = Need::defaulted,
       .fallback = "500",
       .doc = "Longest wait for one answer."},
  };
  t.tables = {drive};
  return t;
}

TableSpec grbl_table() {
  TableSpec axis{.name = "axis",
                 .repeat = Repeat::list,
                 .doc = "How an axis is named and scaled in G-code; one per axis."};
  axis.keys = {
      {.name = "axis", .kind = ValueKind::choice, .choices = dome_axes, .doc = "The axis."},
      {.name = "letter",
       .kind = ValueKind::choice,
       .choices = {"X", "Y", "Z", "A", "B", "C"},
       .doc = "Its letter in G-code."},
      {.name = "units_per_deg",
       .unit = units::per_deg,
       .range = {-1e6, 1e6},
       .doc = "GRBL's millimetres (or degrees) per degree of the axis; negative turns the sense."},
  };
  TableSpec t{.name = "grbl",
              .when = Condition{"backend", {"grbl"}},
              .doc = "A GRBL 1.1 or grblHAL controller, over USB or a serial port."};
  t.keys = {
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
      {.name = "timeout_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {1, 60000},
       .need = Need::defaulted,
       .fallback = "1000",
       .doc = "Longest wait for one answer."},
  };
  t.exactly_one = {{"usb_vendor", "device"}};
  t.tables = {axis};
  return t;
}

TableSpec gantry_lamp_table() {
  TableSpec t{.name = "gantry",
              .when = Condition{"backend", {"gantry"}},
              .doc = "A lamp on an output of the gantry's own controller."};
  t.keys = {{.name = "output",
             .kind = ValueKind::text,
             .doc = "Modbus: an output of the controller profile. GRBL: \"spindle\", \"flood\" or "
                    "\"mist\"."}};
  return t;
}

TableSpec modbus_lamp_table() {
  TableSpec t{.name = "modbus",
              .when = Condition{"backend", {"modbus"}},
              .doc = "A lamp on a Modbus unit of its own."};
  t.keys = endpoint_keys();
  const std::vector<KeySpec> own = {
      {.name = "unit", .kind = ValueKind::integer, .range = {1, 247}, .doc = "Modbus unit number."},
      {.name = "coil",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::optional,
       .doc = "Address of the coil that switches it."},
      {.name = "holding",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::optional,
       .doc = "Address of the register that dims it."},
      {.name = "full_scale",
       .kind = ValueKind::integer,
       .range = {1, 65535},
       .when = Condition{"holding", {}},
       .doc = "Register value of power 1."},
      {.name = "timeout_ms",
       .kind = ValueKind::integer,
       .unit = units::ms,
       .range = {1, 60000},
       .need = Need::defaulted,
       .fallback = "500",
       .doc = "Longest wait for one answer."},
  };
  t.keys.insert(t.keys.end(), own.begin(), own.end());
  t.exactly_one = {{"host", "device"}, {"coil", "holding"}};
  return t;
}

}  // namespace

TableSpec gantry_table() {
  TableSpec t{.name = "gantry",
              .doc = "What carries the lamp: its geometry, its limits, and how it is reached."};
  t.keys = {
      {.name = "kinematics",
       .kind = ValueKind::choice,
       .choices = {"dome"},
       .doc =
           "\"dome\": position = centre + radius (cos e cos a, cos e sin a, sin e), lamp aimed at "
           "the centre."},
      {.name = "centre_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e3, 1e3},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0]",
       .doc = "Centre of the dome."},
      {.name = "radius_m",
       .unit = units::m,
       .range = {0, 100, true},
       .doc = "Distance of the lamp's emitting centre from the dome's centre."},
      {.name = "settle_s",
       .unit = units::s,
       .range = {0, 600},
       .doc = "At rest for so long before an exposure.",
       .why = "it depends on how long the arm swings"},
      {.name = "tolerance_deg",
       .unit = units::deg,
       .range = {0, 10, true},
       .doc = "A move has arrived when every axis is within this of its target.",
       .why = "it decides which frames are believed"},
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
      {.name = "backend",
       .kind = ValueKind::choice,
       .choices = {"modbus", "grbl", "simulated"},
       .doc = "How the gantry is reached; \"simulated\" exists only under --simulate."},
  };
  t.tables = {axis_table(), modbus_table(), grbl_table()};
  return t;
}

TableSpec lamp_table() {
  TableSpec t{
      .name = "lamp",
      .doc = "The lamp: how strong, how far away, how long it may burn, how it is switched."};
  t.keys = {
      {.name = "kind",
       .kind = ValueKind::choice,
       .choices = {"near", "distant"},
       .doc =
           "\"near\": a point at the dome's radius, inverse square. \"distant\": as if infinitely "
           "far in its direction."},
      {.name = "strength_w_per_sr",
       .kind = ValueKind::channels,
       .unit = units::w_per_sr,
       .range = positive,
       .when = Condition{"kind", {"near"}},
       .doc = "Radiant intensity towards the object at power 1."},
      {.name = "strength_w_per_m2",
       .kind = ValueKind::channels,
       .unit = units::w_per_m2,
       .range = positive,
       .when = Condition{"kind", {"distant"}},
       .doc = "Irradiance on a surface facing the lamp at power 1."},
      {.name = "absolute_scale",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .doc = "Strength and sensor response are calibrated; else the result's scale is called "
              "nominal."},
      {.name = "max_power",
       .range = fraction,
       .doc = "The most power any command may ask for.",
       .why = "too much can burn a sample or the lamp"},
      {.name = "power", .range = {0, 1, true}, .doc = "Power used for capture."},
      {.name = "warm_up_s",
       .unit = units::s,
       .range = {0, 7200},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "On for so long before the first exposure."},
      {.name = "max_on_time_s",
       .unit = units::s,
       .range = {0, 86400, true},
       .doc = "The lease: dark after this long without being renewed.",
       .why = "it decides how long a lamp burns when the program has died"},
      {.name = "backend",
       .kind = ValueKind::choice,
       .choices = {"gantry", "modbus", "simulated"},
       .doc = "How the lamp is switched; \"simulated\" exists only under --simulate."},
  };
  t.tables = {gantry_lamp_table(), modbus_lamp_table()};
  return t;
}

}  // namespace lightrig
