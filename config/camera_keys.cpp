#include "config/descriptions.h"

namespace lightrig {
namespace {

TableSpec sensor_table() {
  TableSpec t{.name = "sensor",
              .doc =
                  "The sensor, linear, in the terms of EMVA 1288: counts = black level + electrons "
                  "/ gain."};
  t.keys = {
      {.name = "filter",
       .kind = ValueKind::choice,
       .choices = {"mono", "bayer_rggb", "bayer_grbg", "bayer_gbrg", "bayer_bggr"},
       .doc = "Colour filter; the four letters are the sites of the first two rows, from the top "
              "left."},
      {.name = "demosaic",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .when = Condition{"filter", {"bayer_rggb", "bayer_grbg", "bayer_gbrg", "bayer_bggr"}},
       .doc = "Whether colours are interpolated to every pixel. Without it every sample is taken "
              "at a site of its own colour, which needs no interpolation and is the better choice "
              "unless the object is only a few pixels large."},
      {.name = "bits", .kind = ValueKind::integer, .range = {8, 16}, .doc = "Bits of a count."},
      {.name = "gain_e_per_dn",
       .unit = units::e_per_dn,
       .range = positive,
       .doc =
           "Electrons per count (EMVA 1288: 1/K), from a photon-transfer curve or the data sheet."},
      {.name = "black_level_dn",
       .unit = units::dn,
       .range = not_negative,
       .doc = "Count of a site that saw nothing."},
      {.name = "read_noise_e",
       .unit = units::e,
       .range = not_negative,
       .doc = "Temporal dark noise, rms."},
      {.name = "dark_current_e_per_s",
       .unit = units::e_per_s,
       .range = not_negative,
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Dark current at the sensor's working temperature."},
      {.name = "full_well_e", .unit = units::e, .range = positive, .doc = "Saturation capacity."},
      {.name = "response_e_m2_sr_per_j",
       .kind = ValueKind::channels,
       .unit = units::response,
       .range = positive,
       .doc = "Electrons per second that a site collects per unit of radiance: lens aperture, "
              "pixel area, "
              "transmission and quantum efficiency in one number per channel."},
      {.name = "min_exposure_s",
       .unit = units::s,
       .range = positive,
       .doc = "Shortest exposure that the camera can take."},
      {.name = "max_exposure_s",
       .unit = units::s,
       .range = {0, 3600, true},
       .doc = "Longest exposure that the camera can take."},
  };
  return t;
}

TableSpec aravis_table() {
  TableSpec t{.name = "aravis",
              .when = Condition{"backend", {"aravis"}},
              .doc = "A GigE Vision camera through Aravis."};
  t.keys = {
      {.name = "id",
       .kind = ValueKind::text,
       .doc = "Aravis id (\"Vendor-Model-Serial\"), serial number, or IP address; `lightrig "
              "devices` lists "
              "them. On a host with several networks use the address."},
      {.name = "interface_ip",
       .kind = ValueKind::text,
       .need = Need::defaulted,
       .fallback = "\"\"",
       .doc = "The host's own address on the camera's network; \"\" lets Aravis choose."},
      {.name = "pixel_format",
       .kind = ValueKind::text,
       .need = Need::defaulted,
       .fallback = "\"\"",
       .doc = "GenICam pixel format, such as \"BayerRG12\"; \"\" derives it from filter and bits."},
      {.name = "trigger",
       .kind = ValueKind::choice,
       .need = Need::defaulted,
       .fallback = "\"single_frame\"",
       .choices = {"single_frame", "software"},
       .doc = "How one frame is asked for."},
      {.name = "packet_size_bytes",
       .kind = ValueKind::integer,
       .unit = units::bytes,
       .range = {0, 16000},
       .need = Need::defaulted,
       .fallback = "0",
       .doc = "Size of a stream packet; 0 negotiates the largest that the network carries."},
      {.name = "socket_buffer_bytes",
       .kind = ValueKind::integer,
       .unit = units::bytes,
       .range = {65536, 1 << 30},
       .need = Need::defaulted,
       .fallback = "8388608",
       .doc = "Receive buffer of the stream socket; the system's default loses whole frames."},
      {.name = "packet_socket",
       .kind = ValueKind::boolean,
       .need = Need::defaulted,
       .fallback = "false",
       .doc = "Receive through a packet socket (needs CAP_NET_RAW) rather than UDP."},
      {.name = "port",
       .kind = ValueKind::integer,
       .range = {1, 65535},
       .need = Need::defaulted,
       .fallback = "3956",
       .doc = "GVCP port: cameras listen at 3956, and Aravis asks nowhere else."},
  };
  t.tables = {{.name = "features",
               .need = Need::optional,
               .doc =
                   "GenICam features set after opening, in the order of their names, for instance "
                   "`Gain = 6`. A `UserSetSelector` is loaded before them (`Default` without), "
                   "`OffsetX` and `OffsetY` are set after the picture's size (0 without).",
               .free_form = true}};
  return t;
}

std::vector<KeySpec> projection_keys() {
  return {
      {.name = "width_px",
       .kind = ValueKind::integer,
       .unit = units::px,
       .range = {8, 16384},
       .doc = "Columns of a frame."},
      {.name = "height_px",
       .kind = ValueKind::integer,
       .unit = units::px,
       .range = {8, 16384},
       .doc = "Rows of a frame."},
      {.name = "projection",
       .kind = ValueKind::choice,
       .choices = {"perspective", "orthographic"},
       .doc = "\"orthographic\": a parallel view, as from far away or through a telecentric lens."},
      {.name = "calibration",
       .kind = ValueKind::path,
       .need = Need::optional,
       .when = Condition{"projection", {"perspective"}},
       .doc =
           "File that `lightrig calibrate camera` wrote: focal lengths, principal point and "
           "distortion are taken from it instead of from the keys below; and the camera's place, "
           "instead of from eye_m, target_m and up, where it was made with `--board-origin-m`."},
      {.name = "fx_px",
       .unit = units::px,
       .range = positive,
       .need = Need::optional,
       .when = Condition{"projection", {"perspective"}},
       .doc = "Focal length in columns: focal length over pixel pitch. A perspective "
              "camera needs it or a calibration."},
      {.name = "fy_px",
       .unit = units::px,
       .range = positive,
       .need = Need::optional,
       .when = Condition{"projection", {"perspective"}},
       .doc = "The same in rows; absent: as fx_px."},
      {.name = "scale_px_per_m",
       .unit = units::px_per_m,
       .range = positive,
       .when = Condition{"projection", {"orthographic"}},
       .doc = "Pixels per metre of object."},
      {.name = "cx_px",
       .unit = units::px,
       .need = Need::optional,
       .doc = "Principal point, column; pixel (0, 0) has its centre at 0. Absent: the image's "
              "centre."},
      {.name = "cy_px",
       .unit = units::px,
       .need = Need::optional,
       .doc = "Principal point, row. Absent: the image's centre."},
      {.name = "distortion",
       .kind = ValueKind::numbers,
       .range = {-10, 10},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0, 0, 0]",
       .sizes = {5},
       .when = Condition{"projection", {"perspective"}},
       .doc = "k1, k2, p1, p2, k3 of OpenCV's lens model."},
  };
}

std::vector<KeySpec> pose_keys() {
  return {
      {.name = "eye_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .need = Need::optional,
       .doc = "Where the camera's centre is, in the rig's frame. A camera needs it or a "
              "calibration that states it."},
      {.name = "target_m",
       .kind = ValueKind::vector3,
       .unit = units::m,
       .range = {-1e4, 1e4},
       .need = Need::defaulted,
       .fallback = "[0, 0, 0]",
       .doc = "A point it looks straight at."},
      {.name = "up",
       .kind = ValueKind::vector3,
       .range = {-1e4, 1e4},
       .need = Need::defaulted,
       .fallback = "[0, 0, 1]",
       .doc = "The direction that is upwards in the image."},
      {.name = "lens_cone_deg",
       .unit = units::deg,
       .range = {0, 90},
       .need = Need::optional,
       .doc = "A lamp that stands within this of the line of sight, as the camera sees it, shines "
              "into the lens, and is not used. Absent: half the diagonal of view and 5° more; of a "
              "parallel view nothing."},
  };
}

std::vector<KeySpec> access_keys() {
  return {
      {.name = "readout_ms",
       .unit = units::ms,
       .range = {0, 60000},
       .need = Need::defaulted,
       .fallback = "50",
       .doc = "From the end of an exposure to the frame in hand."},
      {.name = "backend",
       .kind = ValueKind::choice,
       .choices = {"aravis", "simulated"},
       .doc = "How the camera is reached; \"simulated\" exists only under --simulate."},
  };
}

}  // namespace

TableSpec camera_table() {
  TableSpec t{.name = "camera",
              .doc = "Geometry of the camera, its sensor, and how it is reached."};
  for (const auto& part : {projection_keys(), pose_keys(), access_keys()})
    t.keys.insert(t.keys.end(), part.begin(), part.end());
  t.tables = {sensor_table(), aravis_table()};
  return t;
}

}  // namespace lightrig
