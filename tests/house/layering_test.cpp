// The law of the rooms: who may include whom, and which third-party headers each room may see.
// ARCHITECTURE.md, "The rooms".
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/paths.h"

namespace {

namespace fs = std::filesystem;

struct Room {
  std::string folder;                // also the prefix of its #include lines
  std::vector<std::string> sees;     // rooms to its left
  std::vector<std::string> sources;  // third-party headers its .cpp files may include, by prefix
  std::vector<std::string> headers;  // … and its .h files
};

const std::vector<std::string> everywhere = {"Eigen/", "fmt/", "tl/expected.hpp"};

const std::vector<Room> rooms = {
    {"core", {}, {"embree3/", "opencv2/", "dlfcn.h"}, {}},
    {"config",
     {"core"},
     {"toml++/", "assimp/", "openssl/", "nlohmann/", "fcntl.h", "unistd.h", "sys/stat.h"},
     {"nlohmann/"}},
    {"drivers",
     {"core", "config"},
     {"modbus/", "libusb-1.0/", "libusb.h", "arv.h", "glib", "sys/", "net/", "netinet/",
      "termios.h", "fcntl.h", "unistd.h", "poll.h", "ifaddrs.h", "linux/", "arpa/"},
     {}},
    {"sim",
     {"core", "config", "drivers"},
     {"modbus/", "sys/", "netinet/", "termios.h", "fcntl.h", "unistd.h", "poll.h", "pty.h",
      "umockdev", "linux/", "arpa/", "glib", "gio/", "net/", "ifaddrs.h", "nlohmann/", "toml++/"},
     {}},
    {"daemon/session",
     {"core", "config", "drivers", "sim"},
     {"OpenImageIO/", "nlohmann/", "spdlog/", "openssl/", "sys/", "fcntl.h", "unistd.h", "zlib.h"},
     {"nlohmann/"}},
    {"daemon/service",
     {"core", "config", "drivers", "sim", "daemon/session"},
     {"microhttpd.h", "systemd/", "spdlog/", "nlohmann/", "CLI/", "sys/", "netinet/", "arpa/",
      "ifaddrs.h", "fcntl.h", "unistd.h", "poll.h", "grp.h", "pwd.h", "signal.h", "netdb.h",
      "openssl/", "malloc.h"},
     {"nlohmann/", "spdlog/"}},
    {"study",
     {"core", "config", "drivers", "sim", "daemon/session"},
     {"nlohmann/", "boost/multiprecision/", "sys/", "unistd.h"},
     {}},
    {"cli",
     {"core", "config", "drivers", "sim", "daemon/session", "study"},
     {"CLI/", "curl/", "nlohmann/", "sys/", "unistd.h", "spdlog/", "signal.h", "libusb", "fcntl.h",
      "poll.h", "termios.h", "spawn.h"},
     {"CLI/", "nlohmann/"}},
};

struct Include {
  fs::path file;
  int line;
  std::string header;
  bool quoted;
};

std::vector<Include> includes_of(const fs::path& file) {
  static const std::regex directive(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"])");
  std::vector<Include> found;
  std::ifstream in(file);
  std::string text;
  for (int line = 1; std::getline(in, text); ++line) {
    std::smatch match;
    if (std::regex_search(text, match, directive))
      found.push_back({file, line, match[2], match[1] == "\""});
  }
  return found;
}

std::vector<fs::path> sources_of(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.path().extension() == ".h" || entry.path().extension() == ".cpp")
      files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

bool starts_with_any(const std::string& text, const std::vector<std::string>& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& prefix) { return text.starts_with(prefix); });
}

// <vector>, <cmath>: no slash, no dot.
bool is_standard(const std::string& header) {
  return header.find('/') == std::string::npos && header.find('.') == std::string::npos;
}

std::string place(const Include& include) {
  return fs::relative(include.file, lightrig::test::source_dir).string() + ":" +
         std::to_string(include.line) + ": includes " + include.header;
}

fs::path root() { return lightrig::test::source_dir; }

TEST(Layering, ARoomIncludesOnlyItselfAndTheRoomsToItsLeft) {
  for (const Room& room : rooms) {
    for (const fs::path& file : sources_of(root() / room.folder)) {
      for (const Include& include : includes_of(file)) {
        if (!include.quoted) continue;
        std::vector<std::string> allowed = {room.folder + "/"};
        for (const std::string& left : room.sees) allowed.push_back(left + "/");
        EXPECT_TRUE(starts_with_any(include.header, allowed)) << place(include);
        EXPECT_TRUE(fs::exists(root() / include.header) || include.header.ends_with(".inc"))
            << place(include) << ", which is not a file of this repository";
      }
    }
  }
}

TEST(Layering, ARoomSeesOnlyTheThirdPartyHeadersOfItsTable) {
  for (const Room& room : rooms) {
    for (const fs::path& file : sources_of(root() / room.folder)) {
      std::vector<std::string> allowed = everywhere;
      // A header in an optional part's folder is private to that folder (tested below), as a source
      // is.
      const bool is_public = file.extension() == ".h" && file.parent_path() == root() / room.folder;
      const auto& table = is_public ? room.headers : room.sources;
      allowed.insert(allowed.end(), table.begin(), table.end());
      for (const Include& include : includes_of(file)) {
        if (include.quoted || is_standard(include.header)) continue;
        EXPECT_TRUE(starts_with_any(include.header, allowed)) << place(include);
      }
    }
  }
}

TEST(Layering, AnOptionalPartsHeadersAreSeenInItsOwnFolderOnly) {
  for (const Room& room : rooms) {
    for (const fs::path& file : sources_of(root() / room.folder)) {
      for (const Include& include : includes_of(file)) {
        if (!include.quoted || !include.header.starts_with(room.folder + "/")) continue;
        const fs::path part = fs::path(include.header).parent_path();
        if (part == room.folder) continue;
        EXPECT_EQ(fs::relative(file.parent_path(), root()), part) << place(include);
      }
    }
  }
}

TEST(Layering, EmbreeHasOneOwner) {
  for (const fs::path& file : sources_of(root() / "core")) {
    for (const Include& include : includes_of(file)) {
      if (!include.header.starts_with("embree3/")) continue;
      EXPECT_EQ(file.filename(), "occlusion.cpp") << place(include);
    }
  }
}

TEST(Layering, TheSimulatedWorldsShadingSharesNoAngleCodeWithExtractionAndFitting) {
  const std::set<std::string> forbidden = {"core/half_diff.h", "core/samples.h", "core/fit.h",
                                           "core/candidate_bins.h", "core/brdf_basis.h"};
  for (const char* name : {"sim/shading.cpp", "sim/shading.h"}) {
    ASSERT_TRUE(fs::exists(root() / name)) << name;
    // brdf_table.h names the HalfDiff triple in the type of a reflectance; the computation of
    // angles is what must differ.
    for (const Include& include : includes_of(root() / name))
      EXPECT_FALSE(forbidden.contains(include.header)) << place(include);
  }
}

TEST(Layering, CoreReadsNoClockAndOpensNoFile) {
  const std::array banned = {"chrono", "fstream", "filesystem", "iostream", "random", "cstdio"};
  for (const fs::path& file : sources_of(root() / "core")) {
    if (file.filename() == "check.h") continue;  // says why it ends the process
    for (const Include& include : includes_of(file))
      EXPECT_EQ(std::count(banned.begin(), banned.end(), include.header), 0) << place(include);
  }
}

TEST(Layering, NoOptionIsAnIfdef) {
  for (const Room& room : rooms) {
    for (const fs::path& file : sources_of(root() / room.folder)) {
      std::ifstream in(file);
      std::string text;
      for (int line = 1; std::getline(in, text); ++line)
        EXPECT_FALSE(text.find("#if") != std::string::npos &&
                     text.find("LIGHTRIG_WITH") != std::string::npos)
            << fs::relative(file, root()) << ":" << line << ": " << text;
    }
  }
}

TEST(Layering, TheLawItselfFindsAnOffender) {
  const fs::path file = fs::temp_directory_path() / "lightrig_layering_offender.cpp";
  std::ofstream(file) << "#include <vector>\n  #  include \"sim/world.h\"\n#include <arv.h>\n";
  const std::vector<Include> found = includes_of(file);
  fs::remove(file);
  ASSERT_EQ(found.size(), 3U);
  EXPECT_TRUE(is_standard(found[0].header));
  EXPECT_EQ(found[1].header, "sim/world.h");
  EXPECT_TRUE(found[1].quoted);
  EXPECT_EQ(found[1].line, 2);
  EXPECT_FALSE(is_standard(found[2].header));
  EXPECT_FALSE(starts_with_any(found[2].header, rooms.front().sources));
}

}  // namespace
