// The programs as a person runs them: output, exit codes, and what is said when something is wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "drivers/backends.h"
#include "tests/paths.h"

namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::ordered_json;

const std::string lightrig = std::string(lightrig::test::build_dir) + "/lightrig";
const std::string lightrigd = std::string(lightrig::test::build_dir) + "/lightrigd";
const std::string demo = std::string(lightrig::test::source_dir) + "/config/demo.toml";

struct Outcome {
  int code = -1;
  std::string out, err;
};

class CommandLine : public ::testing::Test {
 protected:
  CommandLine() {
    std::string name = (fs::temp_directory_path() / "lightrig-cli-XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  ~CommandLine() override {
    std::error_code error;
    fs::remove_all(folder_, error);
  }
  Outcome run(const std::string& command) {
    const fs::path err = folder_ / "stderr";
    FILE* pipe = popen((command + " 2>" + err.string() + " </dev/null").c_str(), "r");
    Outcome outcome;
    std::array<char, 4096> buffer{};
    for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
      outcome.out.append(buffer.data(), n);
    const int status = pclose(pipe);
    outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    outcome.err = text_of(err);
    return outcome;
  }
  static std::string text_of(const fs::path& path) {
    std::ifstream in(path);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  /// The demo's rig file with one text replaced, in a folder where its profile is.
  std::string changed_rig(const std::string& from, const std::string& to) {
    std::string text = text_of(demo);
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) text.replace(at, from.size(), to);
    fs::copy(fs::path(lightrig::test::source_dir) / "config/controllers", folder_ / "controllers",
             fs::copy_options::recursive | fs::copy_options::overwrite_existing);
    const fs::path path = folder_ / "rig.toml";
    std::ofstream(path) << text;
    return path.string();
  }
  fs::path folder_;
};

TEST_F(CommandLine, ListsItsVerbsAndEachVerbItsOptions) {
  const Outcome help = run(lightrig + " --help");
  EXPECT_EQ(help.code, 0);
  for (const char* verb : {"check", "plan", "dry-run", "start", "abort", "reduce", "verify",
                           "compare", "export", "materials", "backends"}) {
    EXPECT_THAT(help.out, HasSubstr(verb));
    EXPECT_EQ(run(lightrig + " " + verb + " --help").code, 0) << verb;
  }
}

TEST_F(CommandLine, AnswersAMisspeltVerbWithTheOneMeantAndCodeTwo) {
  const Outcome wrong = run(lightrig + " chekc x.toml");
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("\"check\""));
  EXPECT_EQ(run(lightrig).code, 2);
  EXPECT_EQ(run(lightrig + " check").code, 2) << "no rig file given";
  const Outcome choice = run(lightrig + " plan x --criterion best");
  EXPECT_EQ(choice.code, 2);
  EXPECT_TRUE(choice.err.starts_with("lightrig: --criterion")) << choice.err;
  EXPECT_THAT(choice.err, HasSubstr("lightrig plan --help"));
}

/// Valid, or no more wrong than that this build lacks what the rig names.
void expect_valid(const Outcome& checked) {
  const auto built = lightrig::backends();
  if (std::ranges::all_of(built, &lightrig::Backend::built)) {
    EXPECT_EQ(checked.code, 0) << checked.err;
    return;
  }
  EXPECT_EQ(checked.code, 1);
  int missing = 0;
  for (std::size_t at = 0; at < checked.err.size(); at = checked.err.find('\n', at) + 1) {
    const std::string line = checked.err.substr(at, checked.err.find('\n', at) - at);
    // A warning, with its place in the file below it, makes no rig invalid.
    if (line.empty() || line.front() == ' ' || line.find(": warning: ") != line.npos) continue;
    EXPECT_THAT(line, HasSubstr("but this build leaves it out: install lib"));
    ++missing;
  }
  EXPECT_GT(missing, 0);
}

TEST_F(CommandLine, FindsTheShippedRigValid) {
  const Outcome checked = run(lightrig + " check " + demo);
  expect_valid(checked);
  EXPECT_THAT(checked.out, HasSubstr("valid"));
  const Json json = Json::parse(run(lightrig + " check --json " + demo).out);
  EXPECT_TRUE(json["valid"].get<bool>());
}

TEST_F(CommandLine, FindsTheRigOfTheReadmesFirstStepsValid) {
  const std::string readme = text_of(fs::path(lightrig::test::source_dir) / "README.md");
  const auto at = readme.find("mkdir -p my_rig && cp ");
  ASSERT_NE(at, std::string::npos);
  std::string command = readme.substr(at, readme.find('\n', at) - at);
  const std::string folder = (folder_ / "my_rig").string();
  for (auto name = command.find("my_rig"); name != std::string::npos;
       name = command.find("my_rig", name + folder.size()))
    command.replace(name, 6, folder);
  EXPECT_EQ(run(std::string("cd ") + lightrig::test::source_dir + " && " + command).code, 0)
      << command;
  const fs::path rig = folder_ / "my_rig" / "demo.toml";
  std::string text = text_of(rig);
  const auto line = text.find("leave_out_families = [\"plastic\"]");
  ASSERT_NE(line, std::string::npos) << "the line that the README says to delete";
  text.erase(line, text.find('\n', line) - line);
  std::ofstream(rig) << text;
  expect_valid(run(lightrig + " check " + rig.string()));
}

TEST_F(CommandLine, ShowsAMisspeltKeyWithItsPlaceAndTheOneMeant) {
  const std::string rig = changed_rig("settle_s", "setle_s");
  const Outcome checked = run(lightrig + " check " + rig);
  EXPECT_EQ(checked.code, 1);
  EXPECT_THAT(checked.err, HasSubstr("setle_s"));
  EXPECT_THAT(checked.err, HasSubstr("did you mean"));
  EXPECT_THAT(checked.err, HasSubstr(rig + ":"));
  const Json json = Json::parse(run(lightrig + " check --json " + rig).out);
  EXPECT_FALSE(json["valid"].get<bool>());
  EXPECT_GT(json["diagnostics"][0]["line"].get<int>(), 0);
}

TEST_F(CommandLine, SaysWhichFileIsMissing) {
  for (const char* verb : {"check", "plan", "dry-run"}) {
    const Outcome missing = run(lightrig + " " + verb + " /nowhere/rig.toml");
    EXPECT_EQ(missing.code, 1) << verb;
    EXPECT_THAT(missing.err, HasSubstr("/nowhere/rig.toml")) << verb;
  }
  for (const char* verb : {"reduce", "verify", "result"}) {
    const Outcome missing = run(lightrig + " " + verb + " /nowhere/session");
    EXPECT_EQ(missing.code, 1) << verb;
    EXPECT_THAT(missing.err, HasSubstr("/nowhere/session")) << verb;
  }
}

TEST_F(CommandLine, RefusesAnEmptyDirectoryOfMaterials) {
  fs::create_directory(folder_ / "empty");
  const Outcome imported = run(lightrig + " materials import " + (folder_ / "empty").string() +
                               " -o " + (folder_ / "out").string());
  EXPECT_EQ(imported.code, 1);
  EXPECT_THAT(imported.err, HasSubstr((folder_ / "empty").string()));
  const std::string rig = changed_rig("source = \"builtin\"\nleave_out_families = [\"plastic\"]",
                                      "source = \"" + (folder_ / "empty").string() + "\"");
  const Outcome planned = run(lightrig + " plan " + rig);
  EXPECT_EQ(planned.code, 1);
  EXPECT_THAT(planned.err, HasSubstr("empty"));
}

TEST_F(CommandLine, ListsWhatIsPluggedInOrSaysWhatItCannotLookFor) {
  const Outcome listed = run(lightrig + " devices --json");
  EXPECT_EQ(listed.code, 0) << listed.err;
  const Json json = Json::parse(listed.out);
  for (const Json& device : json.at("devices")) EXPECT_FALSE(device.at("kind").empty());
  bool built = false;
  for (const Json& backend : Json::parse(run(lightrig + " backends --json").out))
    built |= backend.at("name") == "aravis" && backend.at("built").get<bool>();
  if (built) return;
  ASSERT_EQ(json.at("problems").size(), 1U);
  EXPECT_THAT(json.at("problems")[0].get<std::string>(), HasSubstr("cameras: not in this build"));
}

TEST_F(CommandLine, TellsOfEachOfARigsDevicesWhetherOrNotTheOthersOpen) {
  const std::string rig = (fs::path(lightrig::test::source_dir) / "config/paper.toml").string();
  const Outcome listed = run(lightrig + " devices --json " + rig);
  EXPECT_EQ(listed.code, 1);
  const Json json = Json::parse(listed.out);
  ASSERT_EQ(json.at("rig").size(), 3U);
  for (const auto& [at, name] : {std::pair(0U, "gantry"), {1U, "lamp"}, {2U, "camera"}}) {
    EXPECT_EQ(json["rig"][at]["device"], name);
    EXPECT_FALSE(json["rig"][at]["opened"].get<bool>());
    const std::string why = std::string("open ") + name + ": ";
    EXPECT_EQ(std::count_if(json["problems"].begin(), json["problems"].end(),
                            [&](const Json& one) {
                              return one.get<std::string>().starts_with(why) &&
                                     one.get<std::string>().find("only in memory") !=
                                         std::string::npos;
                            }),
              1)
        << name;
  }
  const Outcome words = run(lightrig + " devices " + rig);
  EXPECT_THAT(words.out, ::testing::ContainsRegex("camera +does not open"));
  EXPECT_THAT(words.err, HasSubstr("the camera no backend"));
  const Json none = Json::parse(run(lightrig + " devices --json /nowhere/rig.toml").out);
  EXPECT_THAT(none.at("problems").back().get<std::string>(), HasSubstr("no valid rig file"));
}

TEST_F(CommandLine, RehearsesAPlanAsItWasStored) {
  const std::string plan = (folder_ / "plan.json").string();
  ASSERT_EQ(run(lightrig + " plan " + demo + " --lights 2 -o " + plan).code, 0);
  const Json stored =
      Json::parse(run(lightrig + " dry-run --json --plan " + plan + " " + demo).out);
  const Json shots = Json::parse(text_of(plan)).at("lights");
  EXPECT_EQ(stored.at("steps").size(), shots.size());
  EXPECT_LE(shots.size(), 3U) << "not the rig file's own number";
  EXPECT_FALSE(stored.at("remarks").empty());
  EXPECT_TRUE(stored.at("left_out").contains("candidates_unreachable"))
      << stored.at("left_out").dump();
  const Outcome words = run(lightrig + " dry-run --plan " + plan + " " + demo);
  EXPECT_THAT(words.out, HasSubstr("not needed by this scene"));
  EXPECT_THAT(words.out, HasSubstr("remark: "));
  const Outcome missing = run(lightrig + " dry-run --plan /nowhere/plan.json " + demo);
  EXPECT_EQ(missing.code, 1);
  EXPECT_THAT(missing.err, HasSubstr("/nowhere/plan.json"));
}

TEST_F(CommandLine, DrawsATargetThatPrintsTrueToSize) {
  const std::string png = (folder_ / "board.png").string();
  const Outcome drawn = run(lightrig + " calibrate target --columns 9 --rows 6 --square-mm 20" +
                            " --marker-mm 15 -o " + png);
  EXPECT_EQ(drawn.code, 0) << drawn.err;
  EXPECT_THAT(drawn.out, HasSubstr("200 × 140 mm with its white margin, for a sheet of A4"));
  // 200 pixels to a square of 20 mm are 10 000 to the metre, 0x2710.
  const std::string bytes = text_of(png);
  const auto at = bytes.find("pHYs");
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(bytes.substr(at + 4, 9), std::string("\0\0\x27\x10\0\0\x27\x10\x01", 9));
}

TEST_F(CommandLine, SaysHowManyFramesASessionStoresAtMost) {
  const Json dry = Json::parse(run(lightrig + " dry-run --json " + demo).out);
  // Eight dark frames; of every light one without the lamp and eight with it.
  EXPECT_EQ(dry.at("frames_at_most").get<std::size_t>(), 8 + 9 * dry.at("steps").size());
}

TEST_F(CommandLine, KnowsItsMaterials) {
  const Json all = Json::parse(run(lightrig + " materials list --json").out);
  EXPECT_GE(all.size(), 40U);
  const std::string name = all[0]["name"];
  const Json one = Json::parse(run(lightrig + " materials info --json " + name).out);
  EXPECT_EQ(one["name"], name);
  EXPECT_GT(one["values"].get<int>(), 1000);
  EXPECT_EQ(run(lightrig + " materials info unobtainium").code, 1);
}

TEST_F(CommandLine, TellsOfEveryOptionalPartAndOfTheLaboratory) {
  const Json all = Json::parse(run(lightrig + " backends --json").out);
  std::vector<std::string> names;
  for (const Json& one : all) {
    names.push_back(one["name"]);
    if (!one["built"].get<bool>()) {
      EXPECT_THAT(one["remedy"].get<std::string>(), HasSubstr("-DLIGHTRIG_WITH_")) << one.dump();
    }
  }
  EXPECT_THAT(names, ::testing::ElementsAre("modbus", "usb", "aravis", "panel", "sim"));
  const std::string words = run(lightrig + " backends").out;
  for (const std::string& name : names) EXPECT_THAT(words, HasSubstr(name + " "));
}

// Found as aborts: more threads than the system grants, files without end, a result of another
// shape.
TEST_F(CommandLine, EndsInWordsWhateverItIsGiven) {
  const std::string nowhere = folder_.string();
  for (const char* threads : {"100000", "-5", "0", "x"})
    for (const char* verb : {"verify", "reduce"}) {
      const Outcome refused = run(lightrig + " " + verb + " " + nowhere + " --threads " + threads);
      EXPECT_EQ(refused.code, 2) << verb << threads;
      EXPECT_TRUE(refused.err.starts_with("lightrig: --threads")) << refused.err;
    }
  fs::create_symlink("/dev/zero", folder_ / "x.binary");
  const std::string endless = (folder_ / "x.binary").string();
  for (const std::string& words : {" compare /dev/zero " + endless, " materials info " + endless,
                                   std::string(" start --plan /dev/zero --socket /nowhere/s")}) {
    const Outcome refused = run(lightrig + words);
    EXPECT_EQ(refused.code, 1) << words;
    EXPECT_THAT(refused.err, HasSubstr("not a regular file")) << words;
  }
}

TEST_F(CommandLine, ShowsNoResultThatIsNone) {
  fs::create_directories(folder_ / "s" / "result");
  const std::string verb = lightrig + " result " + (folder_ / "s").string();
  for (const char* text :
       {"{}", "[]", "{\"schema\":\"lightrig.result/1\"}", "{\"schema\":\"lightrig.result/9\"}",
        "{\"schema\":\"lightrig.result/1\",\"session\":\"s\",\"state\":\"done\","
        "\"predicted_error_percent\":1,\"curve\":[7]}",
        "not JSON"}) {
    std::ofstream(folder_ / "s" / "result" / "result.json") << text;
    for (const char* how : {"", " --json"}) {
      const Outcome refused = run(verb + how);
      EXPECT_EQ(refused.code, 1) << text << how;
      EXPECT_EQ(refused.out, "") << text << how;
      EXPECT_THAT(refused.err, HasSubstr("result.json is damaged: ")) << text << how;
      EXPECT_THAT(refused.err, HasSubstr("lightrig reduce")) << text << how;
    }
  }
}

TEST_F(CommandLine, NamesThePlanThatIsNone) {
  std::ofstream(folder_ / "p1.json") << "{\n  \"schema\": }";
  const Outcome refused =
      run(lightrig + " start --socket /nowhere/s --plan " + (folder_ / "p1.json").string());
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.err, HasSubstr("p1.json: it is not JSON at line 2, column 13"));
}

TEST_F(CommandLine, SaysThatNoServiceAnswersAndWhatToLookAt) {
  const std::string socket = " --socket " + (folder_ / "no.sock").string();
  for (const char* verb : {"status", "arm", "abort", "start", "watch", "home"}) {
    const Outcome nobody = run(lightrig + " " + verb + socket);
    EXPECT_EQ(nobody.code, 1) << verb;
    EXPECT_THAT(nobody.err, HasSubstr("no lightrigd answers")) << verb;
    EXPECT_THAT(nobody.err, HasSubstr("--socket")) << verb;
  }
}

TEST_F(CommandLine, ArmsNoRealRigByFlag) {
  const Outcome refused =
      run(lightrigd + " --rig " + demo + " --auto-arm --socket " + (folder_ / "s").string());
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.err, HasSubstr("--simulate"));
}

TEST_F(CommandLine, StartsNoServiceOnARootItCannotUse) {
  std::ofstream(folder_ / "file") << "not a folder";
  const Outcome refused =
      run(lightrigd + " --simulate --rig " + demo + " --session-root " +
          (folder_ / "file" / "root").string() + " --socket " + (folder_ / "s").string());
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.err, HasSubstr("session root"));
}

TEST_F(CommandLine, ListensToOtherMachinesOnlyWhenToldSo) {
  const Outcome refused =
      run(lightrigd + " --simulate --rig " + demo + " --listen 0.0.0.0:0 --token-file " +
          (folder_ / "t").string() + " --socket " + (folder_ / "s").string());
  EXPECT_EQ(refused.code, 1);
  EXPECT_THAT(refused.err, HasSubstr("--allow-remote"));
}

TEST_F(CommandLine, CompletesEveryVerbInEveryShell) {
  for (const char* shell : {"bash", "zsh", "fish"}) {
    const Outcome script = run(lightrig + " completion " + shell);
    EXPECT_EQ(script.code, 0);
    EXPECT_THAT(script.out, HasSubstr("dry-run"));
    EXPECT_THAT(script.out, Not(HasSubstr("@VERBS@")));
  }
  EXPECT_EQ(run(lightrig + " completion bash | bash -n").code, 0) << "the script is valid";
}

}  // namespace
