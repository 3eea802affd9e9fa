// Whole sessions through the service's real socket, on the demo's rig made small.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "daemon/session/compare.h"
#include "daemon/session/durable_file.h"
#include "tests/service/story.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;

TEST_F(ServiceStory, StartsUnarmedAndSaysWhyNothingCanMove) {
  const Json now = status();
  EXPECT_EQ(now["state"], "unarmed");
  EXPECT_FALSE(now["ready"].get<bool>());
  EXPECT_THAT(now["why_not_ready"].dump(), HasSubstr("arm the rig"));
  for (const char* path : {"/v1/home", "/v1/sessions"}) {
    const RawReply reply = post(path);
    EXPECT_EQ(reply.status, 409) << path;
    EXPECT_THAT(reply.body, HasSubstr("unarmed"));
  }
}

TEST_F(ServiceStory, TakesASessionFromArmToAResultWithItsTrueError) {
  arm();
  const std::string id = start();
  const Json end = wait_for_state("done");
  const Json session = end["session"];
  EXPECT_EQ(session["id"], id);
  EXPECT_EQ(session["state"], "done");
  EXPECT_EQ(session["shots_done"], session["shots_total"]);
  ASSERT_TRUE(session["true_error_percent"].is_number()) << session.dump(1);
  EXPECT_LT(session["true_error_percent"].get<double>(), 40);
  EXPECT_GE(session["curve"].size(), 3U);

  const auto folder = folder_.path() / "sessions" / id;
  EXPECT_TRUE(std::filesystem::exists(folder / "result" / "brdf.binary"));
  EXPECT_TRUE(std::filesystem::exists(folder / "manifest-sha256.txt")) << "sealed";
  const auto report = verify_session(folder, 2);
  ASSERT_TRUE(report);
  // Nothing was opened but the laboratory in memory, whatever the rig file names.
  EXPECT_EQ(get("/v1/sessions/" + id + "/plan").json()["left_out"]["drivers_not_opened"],
            (Json{"modbus", "usb", "aravis"}));
  EXPECT_TRUE(report->sound) << report->summary
                             << (report->findings.empty() ? "" : report->findings.front());

  EXPECT_EQ(get("/v1/sessions/" + id + "/result").json()["session"], id);
  EXPECT_EQ(get("/v1/sessions").json()["sessions"][0]["id"], id);
  EXPECT_TRUE(get("/v1/preview").body.starts_with("\x89PNG"));
  EXPECT_THAT(get("/metrics").body, HasSubstr("lightrig_sessions_done_total 1\n"));
  EXPECT_FALSE(end["lamp_may_be_on"].get<bool>());
}

TEST_F(ServiceStory, SendsEveryJournalEventOnceAndInOrder) {
  RawConnection events(socket_);
  events.send("GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n");
  arm();
  start();
  wait_for_state("done");
  const std::string text = events.receive("\"state\":\"done\"", 10s);
  std::size_t at = 0;
  int next_id = 0;
  while ((at = text.find("\nid: ", at)) != std::string::npos || next_id == 0) {
    if (at == std::string::npos) break;
    const int id = std::atoi(text.c_str() + at + 5);
    if (next_id != 0) {
      EXPECT_EQ(id, next_id);
    }
    next_id = id + 1;
    ++at;
  }
  EXPECT_GT(next_id, 5) << text.substr(0, 400);
  EXPECT_THAT(text, HasSubstr("event: shot"));
  EXPECT_THAT(text, HasSubstr("event: progress"));
}

TEST_F(ServiceStory, StartsOneSessionForRequestsRepeatedUnderOneKey) {
  arm();
  const std::string first = start(R"({"key":"k1"})");
  EXPECT_EQ(start(R"({"key":"k1"})"), first);
  const RawReply other = post("/v1/sessions", R"({"key":"k2"})");
  EXPECT_EQ(other.status, 409) << "another session while one runs: " << other.body;
  wait_for_state("done");
}

TEST_F(ServiceStory, AbortsAtOnceAndStaysUnarmed) {
  begin(1);  // real time: the session would take minutes
  arm();
  start();
  wait_for([](const Json& now) { return now["state"] == "capturing"; });
  std::this_thread::sleep_for(200ms);
  const RawReply reply = post("/v1/abort", R"({"reason":"test"})");
  EXPECT_EQ(reply.status, 200);
  const Json end = wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  EXPECT_EQ(end["state"], "aborted");
  EXPECT_EQ(end["session"]["state"], "aborted");
  EXPECT_THAT(end["session"]["reason"].get<std::string>(), HasSubstr("tester: test"));
  EXPECT_FALSE(end["lamp_may_be_on"].get<bool>());
  EXPECT_EQ(post("/v1/home").status, 409) << "nothing moves after an abort";
}

// A light that is reduced alongside may take its time; a rig that was aborted is let go of at once.
TEST_F(ServiceStory, GivesItsDevicesBackBeforeTheLightInHandIsReduced) {
  begin(5);
  arm();
  const std::string id = start();
  wait_for([](const Json& now) {
    return now["session"].is_object() && now["session"]["shots_done"].get<int>() >= 2;
  });
  EXPECT_EQ(post("/v1/sessions/" + id + "/halt").status, 202);
  wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  // Whoever reads this frame waits until somebody writes it.
  const auto session = folder_.path() / "sessions" / id;
  const std::string journal = *read_file(session / "journal.jsonl");
  const auto shot = journal.find("\"event\":\"shot\""), file = journal.find("\"file\":\"", shot);
  ASSERT_NE(file, std::string::npos);
  const auto stuck = session / journal.substr(file + 8, journal.find('"', file + 8) - file - 8);
  ASSERT_TRUE(std::filesystem::remove(stuck)) << stuck;
  ASSERT_EQ(mkfifo(stuck.c_str(), 0600), 0);

  EXPECT_EQ(post("/v1/sessions/" + id + "/resume").status, 202);
  int writer = -1;  // opens only once somebody waits for it
  const auto is_read = [&] {
    if (writer < 0) writer = ::open(stuck.c_str(), O_WRONLY | O_NONBLOCK | O_CLOEXEC);
    return writer >= 0;
  };
  wait_for([&](const Json&) { return is_read(); });
  EXPECT_EQ(post("/v1/abort").status, 200);
  const Json now = wait_for([](const Json& moment) { return moment["devices"].is_null(); }, 30s);
  EXPECT_TRUE(now["busy"].get<bool>()) << "nothing was being reduced";
  EXPECT_EQ(now["session"]["state"], "aborted");
  std::filesystem::remove(stuck);  // readers of other formats are tried on it
  ::close(writer);                 // the end of the file: it is no frame
  wait_for([](const Json& moment) { return !moment["busy"].get<bool>(); });
}

TEST_F(ServiceStory, PausesResumesAndStopsAfterAShotWithAResult) {
  begin(5);  // slow enough that no test on a busy machine comes too late
  arm();
  const std::string id = start();
  wait_for([](const Json& now) { return now["state"] == "capturing"; });
  // A client's name need not be UTF-8; it ends in the journal, the log and every status.
  EXPECT_EQ(
      post("/v1/sessions/" + id + "/pause", "{}",
           "X-Lightrig: 1\r\nContent-Type: application/json\r\nX-Lightrig-Client: tester\xff\r\n")
          .status,
      202);
  const Json paused = wait_for([](const Json& now) { return now["state"] == "paused"; });
  EXPECT_THAT(paused["session"]["reason"].get<std::string>(), HasSubstr("tester"));
  EXPECT_EQ(paused["session"]["paused_by"], "person");
  EXPECT_EQ(post("/v1/sessions/" + id + "/pause").status, 202) << "pausing twice is no error";
  EXPECT_EQ(post("/v1/sessions/" + id + "/resume").status, 202);
  wait_for([](const Json& now) { return now["state"] == "capturing"; });
  wait_for([](const Json& now) { return now["session"]["shots_done"].get<int>() >= 2; });
  EXPECT_EQ(post("/v1/sessions/" + id + "/stop").status, 202);
  const Json end = wait_for_state("done");
  EXPECT_LT(end["session"]["shots_done"].get<int>(), end["session"]["shots_total"].get<int>());
  EXPECT_FALSE(end["session"]["result"].is_null());
}

TEST_F(ServiceStory, ResumesAnAbortedSessionAfterARestart) {
  begin(5);
  arm();
  const std::string id = start();
  wait_for([](const Json& now) {
    return now["session"].is_object() && now["session"]["shots_done"].get<int>() >= 1;
  });
  host_.reset();  // the service stops in the middle; without its last word, as after a crash
  const auto journal = folder_.path() / "sessions" / id / "journal.jsonl";
  std::string text = *read_file(journal);
  while (text.rfind("\"event\":\"shot\"") < text.rfind('\n', text.size() - 2))
    text.erase(text.rfind('\n', text.size() - 2) + 1);
  ASSERT_TRUE(write_durably(journal, text));
  begin(std::numeric_limits<double>::infinity());
  EXPECT_EQ(status()["state"], "unarmed") << "nothing moves by itself after a restart";
  const Json listed = get("/v1/sessions").json()["sessions"][0];
  EXPECT_EQ(listed["id"], id);
  EXPECT_EQ(listed["state"], "interrupted") << listed.dump();
  EXPECT_GE(listed["shots_done"].get<int>(), 1);
  EXPECT_GT(listed["shots_planned"].get<int>(), listed["shots_done"].get<int>());
  arm();
  EXPECT_EQ(post("/v1/sessions/" + id + "/resume").status, 202);
  const Json end = wait_for_state("done");
  EXPECT_EQ(end["session"]["id"], id);
  EXPECT_EQ(end["session"]["shots_done"], end["session"]["shots_total"]);
  RawConnection events(socket_);
  events.send("GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(events.receive("\nid: 2\n", 10s), HasSubstr("\nid: 1\nevent: opened\n"))
      << "told from its beginning, though another process captured that";
}

// The curve of a session that another process captured part of is there again while it goes on, not
// only once it is reduced.
TEST_F(ServiceStory, TellsTheErrorsOfBeforeARestartOnceItIsResumed) {
  begin(4);
  arm();
  const std::string id = start();
  const auto captured = [](const Json& now) {
    return now["session"]["state"] != "planning" && now["session"]["shots_done"].get<int>() >= 2;
  };
  wait_for(captured);
  host_.reset();
  begin(4);
  EXPECT_TRUE(status()["session"].is_null());
  arm();
  EXPECT_EQ(post("/v1/sessions/" + id + "/resume").status, 202);
  wait_for([](const Json& moment) { return moment["state"] == "capturing"; });
  EXPECT_EQ(post("/v1/sessions/" + id + "/pause").status, 202);  // it is not over before it is seen
  const Json now = wait_for([](const Json& moment) {
    return moment["state"] == "paused" && !moment["session"]["curve"].empty();
  });
  const Json& first = now["session"]["curve"].front();  // of the two one may be held out
  EXPECT_EQ(first["lights"], 1);
  EXPECT_GT(first["predicted_error_percent"].get<double>(), 0);
  EXPECT_GT(first["elapsed_s"].get<double>(), 0);
  EXPECT_LT(first["elapsed_s"], now["session"]["elapsed_s"]) << "as whoever captured it measured";
  EXPECT_EQ(post("/v1/abort").status, 200);
}

TEST_F(ServiceStory, HomesAndJogsWithinTheTravelOnly) {
  arm();
  EXPECT_EQ(post("/v1/jog", R"({"axis":"azimuth","by_deg":5})").status, 202);
  Json end = wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  EXPECT_EQ(end["commands"].back()["state"], "failed") << "not homed yet";
  EXPECT_THAT(end["commands"].back()["message"].get<std::string>(), HasSubstr("home"));

  EXPECT_EQ(post("/v1/home").status, 202);
  wait_for_state("armed");
  EXPECT_EQ(post("/v1/jog", R"({"axis":"azimuth","to_deg":30})").status, 202);
  end = wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  EXPECT_EQ(end["commands"].back()["state"], "done") << end["commands"].back().dump();
  EXPECT_NEAR(end["devices"]["gantry"]["position"][0].get<double>(), 30 * 3.14159265 / 180, 1e-3);

  EXPECT_EQ(post("/v1/jog", R"({"axis":"azimuth","to_deg":175})").status, 202);
  end = wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  EXPECT_THAT(end["commands"].back()["message"].get<std::string>(),
              HasSubstr("outside its travel"));
  EXPECT_EQ(post("/v1/jog", R"({"axis":"tilt","by_deg":5})").status, 422);
  EXPECT_EQ(post("/v1/jog", R"({"axis":"azimuth","by_mm":5})").status, 422);
}

TEST_F(ServiceStory, LocksOutOthersButNeverAnAbort) {
  const std::string other =
      "X-Lightrig: 1\r\nContent-Type: application/json\r\n"
      "X-Lightrig-Client: somebody\r\n";
  EXPECT_EQ(post("/v1/lock", R"({"note":"aligning"})").status, 200);
  const RawReply held = post("/v1/arm", "{}", other);
  EXPECT_EQ(held.status, 423);
  EXPECT_THAT(held.body, HasSubstr("tester: aligning"));
  EXPECT_EQ(post("/v1/abort", "{}", other).status, 200);
  EXPECT_EQ(post("/v1/unlock", "{}", other).status, 409);
  EXPECT_EQ(post("/v1/unlock", R"({"force":true})", other).status, 200);
  EXPECT_EQ(post("/v1/arm", "{}", other).status, 202);
}

TEST_F(ServiceStory, RefusesABadSessionFileWithItsDiagnosticsAndStaysArmed) {
  arm();
  const RawReply reply = post("/v1/sessions", R"({"session_toml":"[object]\nshpae = 'sphere'\n"})");
  EXPECT_EQ(reply.status, 422);
  EXPECT_THAT(reply.body, HasSubstr("shpae"));
  EXPECT_EQ(status()["state"], "armed");
}

TEST_F(ServiceStory, RefusesASecondServiceOnTheSameRootOrSocket) {
  HostSettings settings;
  settings.service.rig = small_rig(folder_.path());
  settings.service.simulate = true;
  settings.socket = folder_.path() / "other.sock";
  settings.use_activated_sockets = false;
  auto second = Host::start(settings, log_);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("session root"));
  settings.service.rig.session_root = folder_.path() / "other";
  settings.socket = socket_;
  second = Host::start(settings, log_);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("another lightrigd"));
  EXPECT_EQ(status()["state"], "unarmed") << "the first one is unharmed";
}

}  // namespace
}  // namespace lightrig
