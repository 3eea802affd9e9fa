#include "config/descriptions.h"

namespace lightrig {
namespace {

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
       .doc = "Address of the coil that switches it; of fixed lamps the first one's, the others "
              "follow."},
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
      {.name = "temperature",
       .kind = ValueKind::integer,
       .range = {0, 65535},
       .need = Need::optional,
       .doc = "Address of the holding register with the lamp's temperature, a signed count."},
      {.name = "temperature_c_per_count",
       .unit = units::c_per_count,
       .range = {1e-6, 100},
       .when = Condition{"temperature", {}},
       .doc = "What one count of it is."},
      timeout_key("500"),
  };
  t.keys.insert(t.keys.end(), own.begin(), own.end());
  t.exactly_one = {{"host", "device"}, {"coil", "holding"}};
  return t;
}

TableSpec grbl_lamp_table() {
  TableSpec t{.name = "grbl",
              .when = Condition{"backend", {"grbl"}},
              .doc =
                  "A lamp on an output of a GRBL 1.1 or grblHAL controller of its own, over USB "
                  "or a serial port."};
  t.keys = grbl_endpoint_keys();
  t.keys.push_back({.name = "output",
                    .kind = ValueKind::text,
                    .doc = "\"spindle\" (dims), \"flood\" or \"mist\" (on and off)."});
  t.exactly_one = {{"usb_vendor", "device"}};
  return t;
}

/// What kind of source it is.
std::vector<KeySpec> emission_keys() {
  return {
      {.name = "kind",
       .kind = ValueKind::choice,
       .choices = {"near", "distant"},
       .doc = "\"near\": a point where the gantry holds it, inverse square. \"distant\": as if "
              "infinitely far in its direction."},
      {.name = "emission",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"uniform\"",
       .choices = {"uniform", "cosine_power", "table"},
       .when = Condition{"kind", {"near"}},
       .doc =
           "How the lamp's intensity falls off its axis: not at all, as a power of the cosine, or "
           "as a table says."},
      {.name = "emission_exponent",
       .range = {0, 1000, true},
       .when = Condition{"emission", {"cosine_power"}},
       .doc = "The power: 1 for a bare LED, more for a lens."},
      {.name = "emission_angles_deg",
       .kind = ValueKind::numbers,
       .unit = units::deg,
       .range = {0, 180},
       .when = Condition{"emission", {"table"}},
       .doc = "Angles off the axis, increasing from 0; nothing beyond the last."},
      {.name = "emission_relative",
       .kind = ValueKind::numbers,
       .range = {0, 1e6},
       .when = Condition{"emission", {"table"}},
       .doc = "Intensity at these angles in any unit; linear between them."},
  };
}

/// How strong it is.
std::vector<KeySpec> strength_keys() {
  return {
      {.name = "strength_w_per_sr",
       .kind = ValueKind::channels,
       .unit = units::w_per_sr,
       .range = positive,
       .when = Condition{"kind", {"near"}},
       .doc = "Radiant intensity along the lamp's axis at power 1."},
      {.name = "strength_w_per_m2",
       .kind = ValueKind::channels,
       .unit = units::w_per_m2,
       .range = positive,
       .when = Condition{"kind", {"distant"}},
       .doc = "Irradiance on a surface facing the lamp at power 1."},
      {.name = "white_reference",
       .kind = ValueKind::path,
       .need = Need::optional,
       .doc = "File that `lightrig calibrate white` wrote: the strength is taken from it instead "
              "of from the key above, and the result's scale is absolute."},
      {.name = "absolute_scale",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .doc = "Strength and sensor response are calibrated; else the result's scale is called "
              "nominal."},
  };
}

/// What it may be used for, and how long.
std::vector<KeySpec> use_keys() {
  return {
      {.name = "max_power",
       .range = fraction,
       .doc = "The most power any command may ask for.",
       .why = "too much can burn a sample or the lamp"},
      {.name = "power",
       .range = {0, 1, true},
       .doc = "Power used for capture; 1 for a lamp that is only switched."},
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
  };
}

KeySpec backend_key() {
  return {.name = "backend",
          .kind = ValueKind::choice,
          .choices = {"gantry", "modbus", "grbl", "simulated"},
          .doc = "How the lamp is switched; \"simulated\" exists only under --simulate."};
}

}  // namespace

TableSpec lamp_table() {
  TableSpec t{
      .name = "lamp",
      .doc = "The lamp: how strong, how far away, how long it may burn, how it is switched."};
  for (const auto& keys : {emission_keys(), strength_keys(), use_keys()})
    t.keys.insert(t.keys.end(), keys.begin(), keys.end());
  t.keys.push_back(backend_key());
  t.tables = {gantry_lamp_table(), modbus_lamp_table(), grbl_lamp_table()};
  return t;
}

}  // namespace lightrig
