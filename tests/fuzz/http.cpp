// Any bytes on the control socket of a whole service, and the same as the body of each operation
// that takes one. The service must answer a plain question afterwards, and stay unarmed: no request
// here is able to arm it, since nothing is.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "config/read_rig.h"
#include "daemon/service/api.h"
#include "daemon/service/api_body.h"
#include "daemon/service/host.h"
#include "tests/service/raw_http.h"

namespace {

using namespace lightrig;
using namespace std::chrono_literals;

struct Served {
  std::filesystem::path folder;
  std::vector<Axis> axes;
  Log log{LogLevel::error, Log::Sink::none};
  std::unique_ptr<Host> host;

  Served() {
    std::string name = "/dev/shm/lightrig-fuzz-http-XXXXXX";
    folder = mkdtemp(name.data());
    std::ifstream in(std::filesystem::path(LIGHTRIG_SOURCE_DIR) / "config" / "demo.toml");
    std::stringstream text;
    text << in.rdbuf();
    auto rig =
        read_rig_text(text.str(), std::filesystem::path(LIGHTRIG_SOURCE_DIR) / "config/demo.toml");
    if (!rig.value) std::abort();
    rig.value->session_root = folder / "sessions";
    axes = rig.value->gantry.model.axes;
    HostSettings settings;
    settings.service.rig = std::move(*rig.value);
    settings.service.simulate = true;
    settings.service.clock_rate = std::numeric_limits<double>::infinity();
    settings.socket = folder / "s.sock";
    settings.limits.request = 1000ms;
    settings.use_activated_sockets = false;
    auto started = Host::start(std::move(settings), log);
    if (!started) std::abort();
    host = std::move(*started);
  }
  ~Served() {
    host.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static Served served;
  const std::string bytes(data, data + size);
  for (const Route& route : Api::routes()) (void)check_body(bytes, route.body);
  (void)jog_body(bytes, served.axes);
  (void)lamp_body(bytes);
  (void)snap_body(bytes, 1e-5, 2);
  (void)flag_member(bytes, "force");
  (void)start_body(bytes);
  (void)text_member(bytes, "reason");
  (void)parse_tcp_address(bytes);
  {
    RawConnection connection(served.folder / "s.sock");
    connection.send(bytes);
    connection.end_sending();
    connection.receive("\r\n\r\n", 20ms);
  }
  static int calls = 0;
  if (++calls % 64 == 0) {
    served.host->tick();
    if (request(RawConnection(served.folder / "s.sock"), "GET", "/v1/status").status != 200)
      std::abort();
  }
  return 0;
}
