// What the API does when somebody means no good, or a client is broken.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <memory>
#include <thread>
#include <vector>

#include "daemon/service/api_body.h"
#include "daemon/service/host.h"
#include "daemon/session/durable_file.h"
#include "tests/service/raw_http.h"
#include "tests/service/scratch_folder.h"
#include "tests/service/small_rig.h"

namespace lightrig {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

class Attack : public ::testing::Test {
 protected:
  void SetUp() override {
    HostSettings settings;
    settings.service.rig = small_rig(folder_.path());
    settings.service.simulate = true;
    settings.service.clock_rate = std::numeric_limits<double>::infinity();
    settings.socket = socket_;
    settings.listen = TcpAddress{"127.0.0.1", 0, true};
    settings.token_file = folder_.path() / "token";
    settings.limits.connections = 16;
    settings.limits.streams = 4;
    settings.limits.body_bytes = 10000;
    settings.limits.request = 500ms;
    settings.use_activated_sockets = false;
    auto host = Host::start(std::move(settings), log_);
    ASSERT_TRUE(host) << host.error().message;
    host_ = std::move(*host);
    token_ = *read_file(folder_.path() / "token");
    token_.pop_back();
  }
  std::string local_host() const { return "127.0.0.1:" + std::to_string(host_->tcp_port()); }
  std::string host_header() const { return "Host: " + local_host() + "\r\n"; }
  std::string bearer() const { return "Authorization: Bearer " + token_ + "\r\n"; }
  RawReply tcp(const std::string& method, const std::string& path, const std::string& headers,
               const std::string& body = "") {
    return request(RawConnection(host_->tcp_port()), method, path, body, headers);
  }

  ScratchFolder folder_;
  const std::filesystem::path socket_ = folder_.path() / "control.sock";
  Log log_{LogLevel::error, Log::Sink::none};
  std::unique_ptr<Host> host_;
  std::string token_;
};

TEST_F(Attack, NeedsTheTokenForEverythingOverTcp) {
  EXPECT_EQ(tcp("GET", "/v1/status", host_header()).status, 401);
  EXPECT_EQ(tcp("GET", "/v1/status", host_header() + "Authorization: Bearer guess\r\n").status,
            401);
  EXPECT_EQ(tcp("GET", "/v1/status", host_header() + bearer()).status, 200);
  EXPECT_EQ(tcp("POST", "/v1/abort", host_header() + mutation_headers, "{}").status, 401);
}

TEST_F(Attack, KeepsTheTokenFromOthers) {
  struct stat facts {};
  ASSERT_EQ(stat((folder_.path() / "token").c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777, 0600U);
  EXPECT_GE(token_.size(), 64U);
  std::filesystem::permissions(folder_.path() / "token", std::filesystem::perms(0644));
  EXPECT_FALSE(token_of(folder_.path() / "token")) << "a token that others may read is no token";
}

TEST_F(Attack, AnswersNoOtherHostNameAndNoOtherOrigin) {
  EXPECT_EQ(tcp("GET", "/v1/status", "Host: evil.example\r\n" + bearer()).status, 421);
  EXPECT_EQ(
      tcp("GET", "/v1/status", host_header() + bearer() + "Origin: http://evil.example\r\n").status,
      403);
  EXPECT_EQ(
      tcp("GET", "/v1/status", host_header() + bearer() + "Origin: http://" + local_host() + "\r\n")
          .status,
      200);
  EXPECT_EQ(
      request(RawConnection(socket_), "GET", "/v1/status", "", "Origin: http://evil.example\r\n")
          .status,
      403);
}

TEST_F(Attack, AnswersOnAWildcardToThisMachinesNamesAlone) {
  host_.reset();
  HostSettings settings;
  settings.service.rig = small_rig(folder_.path());
  settings.service.simulate = true;
  settings.socket = socket_;
  settings.listen = TcpAddress{"0.0.0.0", 0, false};
  settings.hosts = {"rig.example"};
  settings.token_file = folder_.path() / "token";
  settings.use_activated_sockets = false;
  auto host = Host::start(std::move(settings), log_);
  ASSERT_TRUE(host) << host.error().message;
  host_ = std::move(*host);
  std::array<char, 256> name{};
  ASSERT_EQ(gethostname(name.data(), name.size() - 1), 0);
  const std::string port = ":" + std::to_string(host_->tcp_port());
  const auto asked_as = [&](const std::string& who) {
    return tcp("GET", "/v1/status", "Host: " + who + port + "\r\n" + bearer()).status;
  };
  EXPECT_EQ(asked_as("127.0.0.1"), 200);
  EXPECT_EQ(asked_as(name.data()), 200);
  EXPECT_EQ(asked_as("Rig.Example"), 200);
  EXPECT_EQ(asked_as("evil.example"), 421);
  EXPECT_EQ(asked_as("0.0.0.0"), 421);
}

TEST_F(Attack, TakesNoMutationThatAFormCouldSend) {
  const std::string with_token = host_header() + bearer();
  EXPECT_EQ(tcp("POST", "/v1/arm", with_token + "Content-Type: application/json\r\n", "{}").status,
            403);
  EXPECT_EQ(
      tcp("POST", "/v1/arm", with_token + "X-Lightrig: 1\r\nContent-Type: text/plain\r\n", "{}")
          .status,
      415);
  EXPECT_EQ(tcp("GET", "/v1/arm", with_token).status, 405);
  EXPECT_EQ(host_->service().snapshot().state, State::unarmed);
}

// An ABORT is acted on before its body comes, but not before it is known who asks.
TEST_F(Attack, HeedsNoHeadOfAnAbortThatItWouldRefuse) {
  const std::string begin = "POST /v1/abort HTTP/1.1\r\nContent-Length: 2\r\n", end = "\r\n";
  const std::string good = mutation_headers + host_header() + bearer();
  std::vector<RawConnection> heads;
  for (const std::string& headers :
       {mutation_headers + host_header(),                                      // no token
        mutation_headers + host_header() + "Authorization: Bearer guess\r\n",  // a wrong one
        mutation_headers + bearer() + "Host: evil.example\r\n", good + "Origin: http://evil\r\n",
        host_header() + bearer() + "X-Lightrig: 1\r\n",
        host_header() + bearer() + "Content-Type: application/json\r\n"}) {
    heads.emplace_back(host_->tcp_port());
    heads.back().send(begin + headers + end);
  }
  // Sent last, and so heeded last.
  RawConnection(host_->tcp_port()).send("GET /v1/abort HTTP/1.1\r\n" + good + end);
  heads.emplace_back(host_->tcp_port());
  heads.back().send(begin + good + end);
  const auto until = std::chrono::steady_clock::now() + 10s;
  while (host_->service().snapshot().aborts == 0 && std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(1ms);
  for (RawConnection& head : heads) head.send("{}");
  EXPECT_THAT(heads.back().receive("\r\n\r\n{", 10s), HasSubstr(" 200 "));
  for (std::size_t i = 0; i + 1 < heads.size(); ++i)
    EXPECT_THAT(heads[i].receive("\r\n\r\n{", 10s), HasSubstr(" 4")) << i;
  EXPECT_EQ(host_->service().snapshot().aborts, 1U);
}

TEST_F(Attack, RefusesABodyBeyondItsLimitHoweverItIsSent) {
  const std::string large(20000, ' ');
  EXPECT_EQ(request(RawConnection(socket_), "POST", "/v1/sessions", large, mutation_headers).status,
            413);
  RawConnection chunked(socket_);
  chunked.send("POST /v1/sessions HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n" +
               mutation_headers + "\r\n4e20\r\n" + large + "\r\n0\r\n\r\n");
  EXPECT_THAT(chunked.receive("413", 20s), HasSubstr("413"));
}

// Found as a crash: a body nested 400,000 deep overran the service's stack.
TEST_F(Attack, RefusesABodyThatNestsWithoutEnd) {
  const std::string deep =
      "{\"plan\":{\"a\":" + std::string(4000, '[') + std::string(4000, ']') + "}}";
  const RawReply reply =
      request(RawConnection(socket_), "POST", "/v1/sessions", deep, mutation_headers);
  EXPECT_EQ(reply.status, 422);
  EXPECT_THAT(reply.body, HasSubstr("nests deeper than 64 levels"));
  EXPECT_EQ(request(RawConnection(socket_), "POST", "/v1/lock", deep, mutation_headers).status,
            422);
  EXPECT_EQ(request(RawConnection(socket_), "POST", "/v1/abort", deep, mutation_headers).status,
            200)
      << "an ABORT is one whatever its body holds";
}

TEST_F(Attack, FindsNoFileOutsideTheSessionRoot) {
  std::filesystem::create_directories(folder_.path() / "secret");
  ASSERT_TRUE(write_durably(folder_.path() / "secret" / "plan.json", "secret"));
  std::filesystem::create_directory_symlink(folder_.path() / "secret",
                                            folder_.path() / "sessions" / "link");
  std::filesystem::create_directories(folder_.path() / "sessions" / "real");
  std::filesystem::create_symlink(folder_.path() / "secret" / "plan.json",
                                  folder_.path() / "sessions" / "real" / "plan.json");
  for (const char* id : {"..", "../secret", "..%2fsecret", "%2e%2e%2fsecret", "link", "real",
                         ".lightrigd.lock", "%00", "a%0d%0aX-Evil:%201"}) {
    const RawReply reply =
        request(RawConnection(socket_), "GET", std::string("/v1/sessions/") + id + "/plan");
    EXPECT_EQ(reply.status, 404) << id << ": " << reply.body;
    EXPECT_EQ(reply.body.find("secret\""), std::string::npos) << id;
    EXPECT_EQ(reply.head.find("X-Evil"), std::string::npos) << id;
  }
}

TEST_F(Attack, QuotesNoFileOfTheMachineOverTcp) {
  const RawReply reply = tcp("POST", "/v1/sessions", host_header() + bearer() + mutation_headers,
                             R"({"session_path":"/etc/passwd"})");
  EXPECT_EQ(reply.status, 403);
  EXPECT_EQ(reply.body.find("root:"), std::string::npos);
}

TEST_F(Attack, SurvivesBytesThatAreNoHttp) {
  for (const std::string& bytes :
       {std::string("\0\xff\xfe garbage\r\n\r\n", 16), std::string("GET\r\n\r\n"),
        std::string("POST /v1/abort HTTP/1.1\r\nHost: x\r\nContent-Length: -5\r\n\r\n"),
        std::string("GET /") + std::string(100000, 'a') + " HTTP/1.1\r\n\r\n",
        std::string("POST /v1/jog HTTP/1.1\r\nHost: x\r\n") + mutation_headers +
            "Content-Length: 9\r\n\r\n[[[[[[[[["}) {
    RawConnection connection(socket_);
    connection.send(bytes);
    connection.receive("\r\n\r\n", 300ms);
  }
  EXPECT_EQ(request(RawConnection(socket_), "GET", "/v1/status").status, 200);
}

TEST(RequestBody, RefusesBracketsInBracketsInsteadOfOverflowingTheStack) {
  const std::string deep = std::string(1000000, '[') + std::string(1000000, ']');
  EXPECT_FALSE(jog_body(R"({"axis":)" + deep + "}", {}));
  EXPECT_FALSE(start_body(R"({"plan":)" + deep + "}"));
  EXPECT_FALSE(text_member(R"({"note":)" + deep + "}", "note"));
  EXPECT_EQ(text_member(R"({"note":"[[[ \"{{"})", "note"), "[[[ \"{{")
      << "what is text is no nesting";
}

TEST_F(Attack, DropsAClientThatNeverEndsItsRequest) {
  RawConnection slow(socket_);
  slow.send("POST /v1/abort HTTP/1.1\r\nHost: x\r\n");
  for (int i = 0; i < 400 && !slow.closed(); ++i) {
    slow.send("X-Drip: " + std::to_string(i) + "\r\n");
    slow.receive("never", 50ms);
    host_->tick();
  }
  EXPECT_TRUE(slow.closed()) << "dripping bytes does not keep a connection";
}

TEST_F(Attack, AnswersAbortThoughEveryConnectionIsTaken) {
  std::vector<RawConnection> crowd;
  for (int i = 0; i < 64; ++i) {  // four times what is allowed
    crowd.emplace_back(socket_);
    crowd.back().send("POST /v1/arm HTTP/1.1\r\nHost: x\r\n");  // and never ends
  }
  const auto begun = std::chrono::steady_clock::now();
  const RawReply reply =
      request(RawConnection(socket_), "POST", "/v1/abort", "{}", mutation_headers);
  EXPECT_EQ(reply.status, 200);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, 1900ms) << "they would time out after 2 s";
  EXPECT_EQ(host_->service().snapshot().aborts, 1U);
}

TEST_F(Attack, LimitsTheReadersOfEvents) {
  std::vector<RawConnection> readers;
  int refused = 0;
  for (int i = 0; i < 8; ++i) {
    readers.emplace_back(socket_);
    readers.back().send("GET /v1/events HTTP/1.1\r\nHost: x\r\n\r\n");
    if (readers.back().receive("\r\n\r\n", 20s).find(" 503 ") != std::string::npos) ++refused;
  }
  EXPECT_EQ(refused, 4);
}

}  // namespace
}  // namespace lightrig
