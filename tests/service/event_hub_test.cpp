#include "daemon/service/event_hub.h"

#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <string>

namespace lightrig {
namespace {

struct Listener {
  int slept = 0, woken = 0;
  std::unique_ptr<EventHub::Reader> reader;

  Listener(EventHub& hub, const std::string& session, std::uint64_t after)
      : reader(hub.subscribe(
            session, after, [this] { ++slept; }, [this] { ++woken; })) {}

  /// Everything there is to read now, heartbeats left out.
  std::string drain(std::size_t chunk = 4096) {
    std::string text;
    std::array<char, 4096> buffer{};
    while (true) {
      const auto n = reader->read({buffer.data(), chunk});
      if (!n || *n == 0) break;
      text.append(buffer.data(), *n);
    }
    for (auto at = text.find(": lightrigd"); at != text.npos; at = text.find(": lightrigd"))
      text.erase(at, text.find("\n\n", at) + 2 - at);
    return text;
  }
};

std::string event(int sequence) {
  const std::string n = std::to_string(sequence);
  return "id: " + n + "\nevent: shot\ndata: {\"n\":" + n + "}\n\n";
}

void publish(EventHub& hub, int from, int to) {
  for (int i = from; i <= to; ++i)
    hub.publish(static_cast<std::uint64_t>(i), "shot", "{\"n\":" + std::to_string(i) + "}");
}

TEST(EventHub, ReplaysExactlyWhatAReturningReaderMissed) {
  EventHub hub;
  hub.begin_session("a");
  publish(hub, 1, 5);
  EXPECT_EQ(Listener(hub, "a", 3).drain(), event(4) + event(5));
  EXPECT_EQ(Listener(hub, "a", 5).drain(), "");
  EXPECT_EQ(Listener(hub, "", 0).drain(), event(1) + event(2) + event(3) + event(4) + event(5));
}

TEST(EventHub, TakesAnEventFromOutsideForTheSessionOfWhichItTells) {
  EventHub hub;
  hub.begin_session("a");
  publish(hub, 1, 2);
  hub.publish_of("b", 3, "shot", "{}");
  hub.publish_of("a", 2, "shot", "{}");
  EXPECT_EQ(Listener(hub, "a", 2).drain(), "");
  hub.publish_of("a", 3, "shot", "{\"n\":3}");
  EXPECT_EQ(Listener(hub, "a", 2).drain(), event(3));
}

// Found as progress of the previous session, printed by `start --wait` as that of the new one.
TEST(EventHub, TellsNoProgressOfTheSessionBefore) {
  EventHub hub;
  hub.begin_session("a");
  hub.update("progress", "{\"session\":\"a\"}");
  hub.update("preview", "{}");
  hub.update("state", "{}");
  hub.begin_session("b");
  EXPECT_EQ(Listener(hub, "", 0).drain(), "event: state\ndata: {}\n\n");
  hub.update("progress", "{\"session\":\"b\"}");
  EXPECT_EQ(Listener(hub, "", 0).drain(),
            "event: progress\ndata: {\"session\":\"b\"}\n\nevent: state\ndata: {}\n\n");
}

TEST(EventHub, StartsAnewForAReaderOfAnotherSession) {
  EventHub hub;
  hub.begin_session("b");
  publish(hub, 1, 2);
  EXPECT_EQ(Listener(hub, "a", 1).drain(), event(1) + event(2));
  EXPECT_EQ(Listener(hub, "", 57).drain(), event(1) + event(2)) << "a position beyond the journal";
}

TEST(EventHub, TellsAConnectedReaderTheNewSessionFromItsFirstEvent) {
  EventHub hub;
  hub.begin_session("a");
  publish(hub, 1, 9);
  Listener listener(hub, "a", 0);
  listener.drain();
  hub.begin_session("b");
  publish(hub, 1, 1);
  EXPECT_EQ(listener.drain(), event(1));
}

TEST(EventHub, TellsNothingTwiceOfASessionThatGoesOn) {
  EventHub hub;
  hub.begin_session("a");
  publish(hub, 1, 2);
  Listener listener(hub, "a", 0);
  listener.drain();
  hub.begin_session("a");  // halted and resumed; a line was written meanwhile
  publish(hub, 1, 4);
  EXPECT_EQ(listener.drain(), event(3) + event(4));
  EXPECT_EQ(Listener(hub, "a", 0).drain(), event(1) + event(2) + event(3) + event(4));
}

TEST(EventHub, GivesTheSameBytesInPiecesOfAnySize) {
  EventHub hub;
  hub.begin_session("a");
  publish(hub, 1, 3);
  for (std::size_t chunk : {1U, 7U, 64U})
    EXPECT_EQ(Listener(hub, "a", 0).drain(chunk), event(1) + event(2) + event(3)) << chunk;
}

TEST(EventHub, KeepsOnlyTheNewestValueForASlowReader) {
  EventHub hub;
  Listener listener(hub, "", 0);
  for (int i = 0; i < 1000; ++i) hub.update("progress", "{\"percent\":" + std::to_string(i) + "}");
  EXPECT_EQ(listener.drain(), "event: progress\ndata: {\"percent\":999}\n\n");
}

TEST(EventHub, WakesASleepingReaderOnceHoweverMuchIsPublished) {
  EventHub hub;
  hub.begin_session("a");
  Listener listener(hub, "a", 0);
  listener.drain();
  ASSERT_EQ(listener.slept, 1);
  publish(hub, 1, 100);
  EXPECT_EQ(listener.woken, 1);
}

TEST(EventHub, EndsEveryStreamWhenItCloses) {
  EventHub hub;
  hub.begin_session("a");
  publish(hub, 1, 1);
  Listener listener(hub, "a", 0);
  hub.close();
  EXPECT_EQ(listener.drain(), event(1)) << "what was said before the end is still told";
  std::array<char, 8> buffer{};
  EXPECT_FALSE(listener.reader->read(buffer).has_value());
}

TEST(EventHub, DropsTheOldestEventsBeyondItsLimit) {
  EventHub hub;
  hub.begin_session("a");
  const int n = static_cast<int>(EventHub::history_limit) + 10;
  publish(hub, 1, n);
  const std::string text = Listener(hub, "a", 0).drain();
  EXPECT_TRUE(text.starts_with(event(11)));
  EXPECT_TRUE(text.ends_with(event(n)));
}

}  // namespace
}  // namespace lightrig
