#include "config/descriptions.h"

namespace lightrig {

std::vector<std::string> rotary_axes() { return {"azimuth", "elevation", "pan", "tilt", "turn"}; }
std::vector<std::string> linear_axes() { return {"x", "y", "z"}; }

// A key of a rotary axis and the same of a linear one.
std::vector<KeySpec> both_units(const std::string& name_key, const KeySpec& rotary,
                                const std::string& linear_name, const Unit& linear_unit,
                                const Range& linear_range) {
  KeySpec turning = rotary, sliding = rotary;
  turning.when = Condition{name_key, rotary_axes()};
  sliding.when = Condition{name_key, linear_axes()};
  sliding.name = linear_name;
  sliding.unit = linear_unit;
  sliding.range = linear_range;
  return {std::move(turning), std::move(sliding)};
}

std::vector<std::string> axis_names() {
  std::vector<std::string> names = rotary_axes();
  const std::vector<std::string> linear = linear_axes();
  names.insert(names.end(), linear.begin(), linear.end());
  return names;
}

TableSpec axis_table() {
  TableSpec t{
      .name = "axis",
      .repeat = Repeat::list,
      .when = Condition{"kinematics", {"dome", "cartesian", "cartesian_aimed", "turntable"}},
      .doc =
          "One motorised axis. A dome has \"azimuth\" and \"elevation\"; linear axes are "
          "\"x\", \"y\" and \"z\", an aimed head on them \"pan\" and \"tilt\"; a "
          "turntable has \"turn\" and perhaps \"elevation\"; fixed lamps have none."};
  t.keys = {{.name = "name",
             .kind = ValueKind::choice,
             .choices = axis_names(),
             .doc = "Which axis this is."}};
  const Range mm{-1e5, 1e5};
  const auto add = [&t](const KeySpec& rotary, const std::string& name, const Unit& unit,
                        const Range& range) {
    for (KeySpec& key : both_units("name", rotary, name, unit, range))
      t.keys.push_back(std::move(key));
  };
  add({.name = "min_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .doc = "Least position that any command may ask for.",
       .why = "a wrong limit breaks the rig"},
      "min_mm", units::mm, mm);
  add({.name = "max_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .doc = "Greatest position that any command may ask for.",
       .why = "a wrong limit breaks the rig"},
      "max_mm", units::mm, mm);
  add({.name = "max_speed_deg_per_s",
       .unit = units::deg_per_s,
       .range = {0, 3600, true},
       .doc = "Greatest speed of any move.",
       .why = "too fast a move can hurt people and the rig"},
      "max_speed_mm_per_s", units::mm_per_s, {0, 10000, true});
  add({.name = "max_acceleration_deg_per_s2",
       .unit = units::deg_per_s2,
       .range = {0, 36000, true},
       .doc = "Greatest acceleration of any move.",
       .why = "it depends on the mass that the axis carries"},
      "max_acceleration_mm_per_s2", units::mm_per_s2, {0, 100000, true});
  add({.name = "home_deg",
       .unit = units::deg,
       .range = {-720, 720},
       .doc = "Position of the axis after homing.",
       .why = "it depends on where the switch sits"},
      "home_mm", units::mm, mm);
  return t;
}

TableSpec body_table() {
  TableSpec t{.name = "body",
              .need = Need::optional,
              .doc =
                  "What is solid about the gantry, so that lamp and arm are kept from camera, "
                  "object, floor and keep-out volumes, out of the picture and out of the line "
                  "of sight. Without this table the lamp counts as a point and the arm as "
                  "nothing."};
  t.keys = {
      {.name = "lamp_radius_m",
       .unit = units::m,
       .range = {0, 10},
       .doc = "Radius of a ball about the emitting centre that holds the lamp."},
      {.name = "boom_length_m",
       .unit = units::m,
       .range = {0, 100},
       .doc = "Length of the straight boom that holds the lamp: away from the centre that it is "
              "aimed at, on linear axes along boom_direction; 0 for none."},
      {.name = "boom_radius_m",
       .unit = units::m,
       .range = {0, 10},
       .doc = "Radius of boom and mast."},
      {.name = "boom_direction",
       .kind = ValueKind::vector3,
       .range = {-1e4, 1e4},
       .need = Need::defaulted,
       .fallback = "[0, 0, 1]",
       .doc = "Linear axes: where the boom goes from the lamp."},
      {.name = "mast_foot_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e3, 1e3},
       .need = Need::optional,
       .doc = "Domes and turntables: the boom's end is held by a mast from this point, given from "
              "the centre at azimuth 0; it turns with the azimuth."},
      {.name = "margin_m",
       .unit = units::m,
       .range = {0, 10},
       .doc = "Least distance that lamp and arm keep from anything.",
       .why = "it depends on how well the rig is measured"},
      {.name = "floor_m",
       .unit = units::m,
       .range = {-1e3, 1e3},
       .need = Need::optional,
       .doc = "Height of the floor or table top; nothing goes below."},
      {.name = "camera_radius_m",
       .unit = units::m,
       .range = {0, 10},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Radius of a barrel about the line of sight that holds camera and lens; 0 for none."},
      {.name = "camera_length_m",
       .unit = units::m,
       .range = {0, 10},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "The barrel's length, from the camera's centre backwards."},
  };
  return t;
}

}  // namespace lightrig
