// What a person's word does to a session at moments that are not its capture.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/service/story.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::ordered_json;

class ServiceSteering : public ServiceStory {};

TEST_F(ServiceSteering, HaltsAtOnceAfterTheStartAndTheNextStartIsTaken) {
  begin(1);  // real time: however slow the halt arrives, the session is not done by then
  arm();
  const std::string id = start();
  EXPECT_EQ(post("/v1/sessions/" + id + "/halt").status, 202) << "taken on before it has begun";
  const Json halted = wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  if (halted["state"] == "armed") {
    EXPECT_EQ(halted["session"]["state"], "halted");
    EXPECT_THAT(halted["session"]["reason"].get<std::string>(),
                HasSubstr("halted by tester; nothing had moved"));
    EXPECT_NE(start(), "");
  } else {
    EXPECT_EQ(halted["state"], "paused") << "the plan was made before the halt came";
    EXPECT_EQ(halted["session"]["paused_by"], "person");
    EXPECT_EQ(post("/v1/sessions/" + id + "/resume").status, 202);
  }
  EXPECT_EQ(post("/v1/abort").status, 200);
}

TEST_F(ServiceSteering, TellsWhatBecameOfAPauseAndAHalt) {
  begin(1);
  arm();
  const std::string id = start();
  wait_for([](const Json& now) { return now["state"] == "capturing"; });
  const auto record = [](const Json& now, std::uint64_t number) -> Json {
    for (const Json& one : now["commands"])
      if (one["id"] == number) return one;
    return {};
  };
  const auto outcome = [&](const std::string& verb) {
    const RawReply reply = post("/v1/sessions/" + id + "/" + verb);
    EXPECT_EQ(reply.status, 202) << reply.body;
    const auto number = reply.json()["command"].get<std::uint64_t>();
    const Json now =
        wait_for([&](const Json& seen) { return record(seen, number)["state"] != "running"; });
    EXPECT_EQ(record(now, number)["command"], verb);
    return record(now, number);
  };
  EXPECT_EQ(outcome("pause")["state"], "done");
  EXPECT_EQ(status()["state"], "paused");
  EXPECT_EQ(outcome("pause")["message"], "the session is paused");
  EXPECT_EQ(outcome("halt")["state"], "done");
  EXPECT_FALSE(status()["busy"]);

  // Resumed, it homes first: an ABORT then leaves a pause nothing to wait for.
  post("/v1/sessions/" + id + "/resume");
  wait_for([](const Json& now) { return now["session"]["activity"] == "homing"; });
  const RawReply reply = post("/v1/sessions/" + id + "/pause");
  EXPECT_EQ(post("/v1/abort").status, 200);
  const auto number = reply.json()["command"].get<std::uint64_t>();
  const Json now =
      wait_for([&](const Json& seen) { return record(seen, number)["state"] != "running"; });
  EXPECT_EQ(record(now, number)["state"], "failed");
  EXPECT_THAT(record(now, number)["message"].get<std::string>(),
              HasSubstr("the session ended first"));
}

TEST_F(ServiceSteering, ReachesNoCommandThatIsNotTheSessions) {
  begin(1);
  arm();
  const std::string id = start();
  EXPECT_EQ(post("/v1/abort").status, 200);
  wait_for_state("aborted");
  arm();
  EXPECT_EQ(post("/v1/home").status, 202);
  for (const char* verb : {"pause", "halt", "stop"})
    EXPECT_EQ(post("/v1/sessions/" + id + "/" + verb).status, 409) << verb;
  const Json now = status();
  EXPECT_EQ(now["commands"].back()["command"], "home");
  EXPECT_NE(now["commands"].back()["state"], "failed");
  EXPECT_EQ(now["session"]["state"], "aborted");
  EXPECT_EQ(post("/v1/abort").status, 200);
}

// Found: 4 MB of short names took the parser minutes, on the thread that an ABORT arrives at.
TEST_F(ServiceSteering, AbortsWhileABodyOfVeryManyNamesIsRead) {
  std::string names = "{";
  while (names.size() < (std::size_t{3} << 20))
    names += "\"" + std::to_string(names.size()) + "\":1,";
  names += "\"key\":\"k\"}";
  std::vector<RawConnection> crowd;
  for (const char* path : {"/v1/sessions", "/v1/lock", "/v1/abort"}) {
    crowd.emplace_back(socket_);
    crowd.back().send(std::string("POST ") + path + " HTTP/1.1\r\nHost: x\r\n" + mutation_headers +
                      "Content-Length: " + std::to_string(names.size()) + "\r\n\r\n" + names);
  }
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_EQ(post("/v1/abort").status, 200);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(15));
  EXPECT_THAT(crowd[0].receive("\r\n\r\n{", std::chrono::seconds(60)), HasSubstr(" 422 "));
  EXPECT_THAT(crowd[1].receive("\r\n\r\n{", std::chrono::seconds(60)), HasSubstr(" 413 "));
  EXPECT_THAT(crowd[2].receive("\r\n\r\n{", std::chrono::seconds(60)), HasSubstr(" 200 "));
  EXPECT_EQ(host_->service().snapshot().aborts, 2U);
}

// The body says what for; whether it ever comes is nothing to wait for.
TEST_F(ServiceSteering, AbortsByARequestsHeadAndTakesTheReasonThatComesLater) {
  begin(1);
  arm();
  start();
  RawConnection slow(socket_);
  const std::string body = R"({"reason":"the arm creaks"})";
  slow.send("POST /v1/abort HTTP/1.1\r\nHost: x\r\n" + mutation_headers +
            "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n");
  // Not for its end as well: a request must be whole within ten seconds.
  wait_for([](const Json& now) { return now["state"] == "aborted"; });
  EXPECT_EQ(slow.receive("HTTP", std::chrono::milliseconds(0)), "") << "not answered yet";
  slow.send(body);
  EXPECT_THAT(slow.receive("\r\n\r\n{", std::chrono::seconds(10)), HasSubstr(" 200 "));
  const Json now = wait_for_state("aborted");
  EXPECT_EQ(now["session"]["reason"], "aborted by tester: the arm creaks");
  EXPECT_THAT(now["why_not_ready"].dump(), HasSubstr("the arm creaks"));
  EXPECT_EQ(host_->service().snapshot().aborts, 1U);

  // What comes too late explains an abort, and is none of what was begun since.
  RawConnection slower(socket_);
  slower.send("POST /v1/abort HTTP/1.1\r\nHost: x\r\n" + mutation_headers +
              "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n");
  wait_for([&](const Json&) { return host_->service().snapshot().aborts == 2; });
  arm();
  slower.send(body);
  EXPECT_THAT(slower.receive("\r\n\r\n{", std::chrono::seconds(10)), HasSubstr(" 200 "));
  EXPECT_EQ(status()["state"], "armed");
}

// A body that nobody reads in full is no reason not to stop.
TEST_F(ServiceSteering, AbortsThoughItsBodyIsAnnouncedAsTooLarge) {
  arm();
  RawConnection large(socket_);
  large.send("POST /v1/abort HTTP/1.1\r\nHost: x\r\n" + mutation_headers +
             "Content-Length: 99999999999\r\n\r\n");
  EXPECT_THAT(large.receive("\r\n\r\n{", std::chrono::seconds(20)), HasSubstr(" 200 "))
      << "answered by its head";
  large.receive("never", std::chrono::seconds(20));
  EXPECT_TRUE(large.closed()) << "what follows is not read";
  wait_for_state("unarmed");
  EXPECT_EQ(host_->service().snapshot().aborts, 1U);
}

TEST_F(ServiceSteering, MovesOnceForRequestsRepeatedUnderOneKey) {
  arm();
  EXPECT_EQ(post("/v1/home").status, 202);
  wait_for_state("armed");
  const std::string step = R"({"axis":"azimuth","by_deg":5,"key":"k1"})";
  const Json first = post("/v1/jog", step).json();
  wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  EXPECT_EQ(post("/v1/jog", step).json()["command"], first["command"]);
  const Json end = wait_for([](const Json& now) { return !now["busy"].get<bool>(); });
  EXPECT_NEAR(end["devices"]["gantry"]["position"][0].get<double>(), 5 * 3.14159265 / 180, 1e-3);
}

TEST_F(ServiceSteering, LightsAndLooksOnceForRequestsRepeatedUnderOneKey) {
  arm();
  const auto idle = [](const Json& now) { return !now["busy"].get<bool>(); };
  const auto command_of = [&](const std::string& path, const std::string& body) {
    const RawReply reply = post(path, body);
    EXPECT_EQ(reply.status, 202) << reply.body;
    wait_for(idle);
    return reply.json()["command"];
  };
  const std::string look = R"({"exposure_s":0.01,"lamp":true,"key":"k1"})";
  const Json first = command_of("/v1/snap", look);
  EXPECT_EQ(command_of("/v1/snap", look), first);
  EXPECT_NE(command_of("/v1/snap", R"({"exposure_s":0.01,"lamp":true,"key":"k2"})"), first);
  EXPECT_NE(command_of("/v1/snap", R"({"exposure_s":0.01})"), first) << "no key is no key";
  const Json lit = command_of("/v1/lamp", R"({"power":0.5,"key":"k1"})");
  EXPECT_NE(lit, first) << "a key is its command's own";
  command_of("/v1/lamp", R"({"power":0})");
  EXPECT_EQ(command_of("/v1/lamp", R"({"power":0.5,"key":"k1"})"), lit);
  EXPECT_EQ(status()["devices"]["lamp"]["power"], 0) << "it came late, and lights nothing";
  EXPECT_EQ(post("/v1/lamp", R"({"power":0,"key":1})").status, 422);
}

TEST_F(ServiceSteering, WaitsForSpaceBeforeItsResultAndGoesOnByItself) {
  // Inputs, truth and frames take 0.62 MiB; radiance and result 0.73 MiB more.
  const SmallDisk disk(1 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "mounting a small tmpfs needs root";
  session_root_ = disk.path();
  begin(std::numeric_limits<double>::infinity());
  arm();
  start();
  const Json paused = wait_for([](const Json& now) {
    return now["state"] == "paused" || (!now["busy"].get<bool>() && now["state"] != "armed");
  });
  EXPECT_EQ(paused["state"], "paused");
  EXPECT_EQ(paused["session"]["paused_by"], "no_space");
  EXPECT_THAT(paused["session"]["reason"].get<std::string>(), HasSubstr("free some space"));
  EXPECT_EQ(paused["devices"]["lamp"]["power"], 0);
  ASSERT_EQ(::mount("tmpfs", disk.path().c_str(), "tmpfs", MS_REMOUNT, "size=20m"), 0);
  const Json end = wait_for_state("done");
  EXPECT_FALSE(end["session"]["result"].is_null());
  EXPECT_TRUE(end["session"]["paused_by"].is_null());
  host_.reset();  // before its disk goes
}

}  // namespace
}  // namespace lightrig
