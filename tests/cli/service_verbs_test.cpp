// Verbs that ask the service, as a person types them, and what is said back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "cli/abort_line.h"
#include "tests/cli/running_service.h"

namespace lightrig {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class ServiceVerbs : public RunningService {};

// Found as: usage errors that sent nothing.
TEST_F(ServiceVerbs, SendAnAbortWhateverElseStandsOnItsLine) {
  begin_service("inf");
  const Said words = ask("abort the door jams");
  EXPECT_EQ(words.code, 0) << words.text;
  EXPECT_THAT(words.text, HasSubstr("aborted: motion stopped, lamp dark, rig unarmed"));
  EXPECT_THAT(words.text, Not(HasSubstr("--help")));
  EXPECT_THAT(log(), HasSubstr("the door jams"));
  EXPECT_THAT(lightrig("status"), HasSubstr("state      unarmed"));

  lightrig("arm");
  const Said option = ask("abort --nwo --reason smoke everywhere --as");
  EXPECT_EQ(option.code, 0) << option.text;
  EXPECT_THAT(option.text, HasSubstr("abort left --nwo aside"));
  EXPECT_LT(option.text.find("aborted: motion stopped"), option.text.find("--nwo"))
      << "first it is sent";
  EXPECT_THAT(log(), HasSubstr("smoke everywhere"));
  EXPECT_THAT(lightrig("status"), HasSubstr("state      unarmed"));
}

// Found as: "GET /v1/sessions lists them", and a refusal by the lock that began with a folder that
// is not there.
TEST_F(ServiceVerbs, SpeakOfSessionsAsThisProgramDoes) {
  begin_service("inf");
  const std::string id = whole_session();
  for (const std::string verb :
       {"resume nope", "pause nope", "resume nope/nope", "retake nope L01"}) {
    const Said said = ask(verb);
    EXPECT_EQ(said.code, 1) << verb;
    EXPECT_THAT(said.text, HasSubstr("lightrig sessions lists them")) << verb;
    EXPECT_THAT(said.text, Not(HasSubstr("/v1/"))) << verb;
  }
  const char* nowhere = "there is no session folder";
  EXPECT_THAT(lightrig("retake nope L01"), HasSubstr(nowhere));
  const std::string shot = lightrig("retake " + id + " L77");
  EXPECT_THAT(shot, HasSubstr("no such shot"));
  EXPECT_THAT(shot, Not(HasSubstr(nowhere)));
  lightrig("lock --as bob");
  const std::string locked = lightrig("retake " + id + " L02 --as eve");
  EXPECT_THAT(locked, HasSubstr("the rig is locked by bob"));
  EXPECT_THAT(locked, Not(HasSubstr(nowhere)));
}

// Found as: "result", "done, 4 of 4 lights", and 19 findings of which none said why.
TEST_F(ServiceVerbs, SayWhereTheyShowAResultThatALightOfItIsOpen) {
  begin_service("inf");
  const std::string id = whole_session();
  EXPECT_THAT(lightrig("sessions"), HasSubstr("result"));
  EXPECT_EQ(ask("retake " + id + " L02").code, 0);

  const std::string open = "L02 open; lightrig resume " + id;
  for (const std::string verb : {"sessions", "status", "watch"})
    EXPECT_THAT(lightrig(verb), HasSubstr(open)) << verb;
  const std::string result = lightrig("result " + folder_of(id));
  EXPECT_LT(result.find(open), result.find("session " + id + " of")) << result;
  EXPECT_THAT(lightrig("result --json " + folder_of(id)), HasSubstr(open));
  const Said verified = ask("verify " + folder_of(id));
  EXPECT_EQ(verified.code, 1);
  EXPECT_THAT(verified.text.substr(0, verified.text.find('\n')), HasSubstr(open));
  kill_service();
  begin_service("inf");
  EXPECT_THAT(lightrig("status"), HasSubstr("unfinished " + id + ": " + open));

  EXPECT_EQ(ask("resume " + id).code, 0);
  EXPECT_THAT(lightrig("watch"), HasSubstr("is done after"));
  for (const std::string verb : {"sessions", "status", "watch", "result"})
    EXPECT_THAT(lightrig(verb + (verb == "result" ? " " + folder_of(id) : "")),
                Not(HasSubstr(open)))
        << verb;
  EXPECT_EQ(ask("verify " + folder_of(id)).code, 0);
}

// Found as: a folder's name went past the lock, and past the log.
TEST_F(ServiceVerbs, RetakeAFolderOfTheServiceThroughTheService) {
  begin_service("inf");
  const std::string id = whole_session();
  lightrig("lock --as bob");
  const Said locked = ask("retake " + folder_of(id) + "/ L02 --as eve");
  EXPECT_EQ(locked.code, 1);
  EXPECT_THAT(locked.text, HasSubstr("the rig is locked by bob"));
  EXPECT_THAT(lightrig("sessions"), Not(HasSubstr("open")));
  EXPECT_EQ(ask("retake " + folder_of(id) + " L02 --as bob").code, 0);
  EXPECT_THAT(log(), HasSubstr("event=retake"));

  // A folder elsewhere is none of the service's, and without a service there is nobody to ask.
  const std::string copy = (folder_.path() / "copy").string();
  std::filesystem::copy(folder_of(id), copy, std::filesystem::copy_options::recursive);
  EXPECT_EQ(ask("retake " + copy + " L01 --as eve").code, 0);
  EXPECT_THAT(lightrig("sessions"), HasSubstr(" L02 open"));
  kill_service();
  const Said alone = ask("retake " + folder_of(id) + " L01 --as eve");
  EXPECT_EQ(alone.code, 0) << alone.text;
}

TEST(AbortLine, TakesWhatItKnowsAndCallsTheRestTheReason) {
  const cli::ServiceOptions usual{"/run/s", "eve", false};
  const auto read = [&](const std::vector<std::string>& words) {
    return cli::read_abort_line(words, usual);
  };
  EXPECT_FALSE(read({"arm", "abort"})) << "another verb";
  EXPECT_FALSE(read({}));
  const auto bare = read({"abort"});
  ASSERT_TRUE(bare);
  EXPECT_EQ(bare->service.socket, "/run/s");
  EXPECT_EQ(bare->service.as, "eve");
  EXPECT_EQ(bare->reason, "");
  const auto full = read({"--socket", "/x", "abort", "now", "--reason", "smoke", "at", "once",
                          "--as=bob", "--json", "-f", "--socket"});
  ASSERT_TRUE(full);
  EXPECT_EQ(full->service.socket, "/x");
  EXPECT_EQ(full->service.as, "bob");
  EXPECT_TRUE(full->service.json);
  EXPECT_EQ(full->reason, "smoke now at once");
  EXPECT_THAT(full->unknown, ElementsAre("-f", "--socket without a value"));
  EXPECT_THAT(read({"abort", "--reason=", "x"})->unknown, IsEmpty());
}

}  // namespace
}  // namespace lightrig
