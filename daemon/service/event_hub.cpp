#include "daemon/service/event_hub.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace lightrig {

EventHub::Reader::~Reader() {
  const std::lock_guard lock(hub_.mutex_);
  std::erase(hub_.readers_, this);
}

std::optional<std::size_t> EventHub::Reader::read(std::span<char> out) {
  const std::lock_guard lock(hub_.mutex_);
  if (pending_.empty() && !compose()) {
    if (hub_.closed_) return {};
    asleep_ = true;
    sleep_();
    return 0;
  }
  const std::size_t n = std::min(out.size(), pending_.size());
  std::copy_n(pending_.begin(), n, out.begin());
  pending_.erase(0, n);
  return n;
}

// One event at a time: what a reader does not take is never copied for it.
bool EventHub::Reader::compose() {
  if (epoch_ != hub_.epoch_) {
    epoch_ = hub_.epoch_;
    after_ = 0;
  }
  const auto next = std::upper_bound(
      hub_.history_.begin(), hub_.history_.end(), after_,
      [](std::uint64_t after, const Entry& entry) { return after < entry.sequence; });
  if (next != hub_.history_.end()) {
    pending_ = next->text;
    after_ = next->sequence;
    return true;
  }
  for (const auto& [name, value] : hub_.values_)
    if (seen_[name] < value.version) {
      pending_ = value.text;
      seen_[name] = value.version;
      return true;
    }
  if (heartbeat_due_) {
    heartbeat_due_ = false;
    pending_ = ": lightrigd is here\n\n";
    return true;
  }
  return false;
}

void EventHub::begin_session(const std::string& id) {
  const std::lock_guard lock(mutex_);
  if (session_ == id) return;
  session_ = id;
  ++epoch_;
  history_.clear();
  // Values told of the session before; "state" is the service's own and stays true.
  values_.erase("progress");
  values_.erase("preview");
}

void EventHub::publish(std::uint64_t sequence, const std::string& event, const std::string& json) {
  const std::lock_guard lock(mutex_);
  append(sequence, event, json);
}

void EventHub::publish_of(const std::string& session, std::uint64_t sequence,
                          const std::string& event, const std::string& json) {
  const std::lock_guard lock(mutex_);
  if (session_ == session) append(sequence, event, json);
}

void EventHub::append(std::uint64_t sequence, const std::string& event, const std::string& json) {
  if (!history_.empty() && sequence <= history_.back().sequence) return;
  history_.push_back(
      {sequence, fmt::format("id: {}\nevent: {}\ndata: {}\n\n", sequence, event, json)});
  if (history_.size() > history_limit) history_.pop_front();
  wake_all();
}

void EventHub::update(const std::string& name, std::string json) {
  const std::lock_guard lock(mutex_);
  values_[name] = {++version_, fmt::format("event: {}\ndata: {}\n\n", name, json)};
  wake_all();
}

void EventHub::heartbeat() {
  const std::lock_guard lock(mutex_);
  for (Reader* reader : readers_) reader->heartbeat_due_ = true;
  wake_all();
}

void EventHub::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  wake_all();
}

std::unique_ptr<EventHub::Reader> EventHub::subscribe(const std::string& session,
                                                      std::uint64_t after,
                                                      std::function<void()> sleep,
                                                      std::function<void()> wake) {
  const std::lock_guard lock(mutex_);
  std::unique_ptr<Reader> reader(new Reader(*this, std::move(sleep), std::move(wake)));
  reader->epoch_ = epoch_;
  // A position beyond the present journal belongs to another session: begin at its start.
  const bool same = session.empty() || session == session_;
  const bool possible = !history_.empty() && after <= history_.back().sequence;
  reader->after_ = same && possible ? after : 0;
  readers_.push_back(reader.get());
  return reader;
}

std::size_t EventHub::readers() const {
  const std::lock_guard lock(mutex_);
  return readers_.size();
}

void EventHub::wake_all() {
  for (Reader* reader : readers_)
    if (std::exchange(reader->asleep_, false)) reader->wake_();
}

}  // namespace lightrig
