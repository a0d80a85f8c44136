#include "anigen/studio/bounded_server.h"

#include <poll.h>
#include <sys/socket.h>
#include <algorithm>
#include <cstddef>
#include <exception>
#include <string_view>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/log.h"
#include "anigen/core/text.h"

namespace anigen::studio {

namespace {

using HeadClock = std::chrono::steady_clock;

constexpr std::string_view kHeadEnd = "\n\r\n";
constexpr std::size_t kMostHead = 64 << 10;
constexpr std::size_t kLongestRange = 100;  // "Range: bytes=N-M" with numbers of 19 digits is shorter
constexpr int kHeadLookMilliseconds = 100;
constexpr std::chrono::seconds kFarewell{1};

/// A request of which the head, and perhaps more, has been read. What follows the head is there only after go_on(): a
/// reader of the head cannot miss its end and read on.
class RequestStream : public httplib::Stream {
 public:
  RequestStream(httplib::Stream& socket, std::string bytes)
      : socket_(socket), bytes_(std::move(bytes)), end_(bytes_.find(kHeadEnd)) {
    end_ = end_ == std::string::npos ? bytes_.size() : end_ + kHeadEnd.size();
  }

  void go_on() {
    goes_on_ = true;
    end_ = bytes_.size();
  }

  bool is_readable() const override { return at_ < end_ || (goes_on_ && socket_.is_readable()); }
  bool is_writable() const override { return socket_.is_writable(); }
  ssize_t read(char* to, std::size_t size) override {
    if (at_ == end_) return goes_on_ ? socket_.read(to, size) : 0;
    const std::size_t count = bytes_.copy(to, std::min(size, end_ - at_), at_);
    at_ += count;
    return static_cast<ssize_t>(count);
  }
  ssize_t write(const char* from, std::size_t size) override { return socket_.write(from, size); }
  void get_remote_ip_and_port(std::string& ip, int& port) const override { socket_.get_remote_ip_and_port(ip, port); }
  void get_local_ip_and_port(std::string& ip, int& port) const override { socket_.get_local_ip_and_port(ip, port); }
  socket_t socket() const override { return socket_.socket(); }

 private:
  httplib::Stream& socket_;
  std::string bytes_;
  std::size_t at_ = 0, end_;
  bool goes_on_ = false;
};

/// The head asks for several ranges. A long one counts as such, since httplib matches it by a regular expression, which
/// takes hundreds of bytes of stack for each of its own; so does an escape, behind which a comma can hide.
bool has_several_ranges(const std::string& head) {
  const std::string text = lower_case(head), name = "\nrange:";
  for (std::size_t at = 0; (at = text.find(name, at)) != std::string::npos; at += name.size()) {
    const std::string line = text.substr(at + 1, text.find('\n', at + 1) - at - 1);
    if (line.size() > kLongestRange || line.find_first_of(",%") != std::string::npos) return true;
  }
  return false;
}

/// Answers a request that httplib does not see. @param status with its words, such as "408 Request Timeout"
void send_refusal(httplib::Stream& stream, const std::string& status, const std::string& problem) {
  const std::string body = Json{{"error", problem}}.dump();
  stream.write("HTTP/1.1 " + status + "\r\nConnection: close\r\nContent-Type: application/json\r\nContent-Length: " +
               std::to_string(body.size()) + "\r\n\r\n" + body);
  // A system that closes a connection with bytes unread takes back what the client has not read yet.
  const socket_t socket = stream.socket();
  ::shutdown(socket, SHUT_WR);
  char piece[4096];
  for (const auto begin = HeadClock::now(); HeadClock::now() - begin < kFarewell;) {
    pollfd watched{socket, POLLIN, 0};
    if (::poll(&watched, 1, kHeadLookMilliseconds) > 0 && ::recv(socket, piece, sizeof piece, 0) <= 0) return;
  }
}

}  // namespace

bool BoundedServer::process_and_close_socket(socket_t socket) {
  bool answered = false;
  try {
    // By its name for clients; it makes a stream of any socket.
    answered = httplib::detail::process_client_socket(socket, read_timeout_sec_, read_timeout_usec_, write_timeout_sec_,
                                                      write_timeout_usec_,
                                                      [this](httplib::Stream& stream) { return serve(stream); });
  } catch (const std::exception& error) {
    log::error("a request: {}", error.what());
  }
  ::shutdown(socket, SHUT_RDWR);
  httplib::detail::close_socket(socket);
  return answered;
}

bool BoundedServer::serve(httplib::Stream& stream) {
  std::string bytes;
  switch (read_head(stream.socket(), bytes)) {
    case Head::kWhole:
      break;
    case Head::kGone:
      return false;
    case Head::kTooLong:
      send_refusal(stream, "431 Request Header Fields Too Large",
                   "the head of the request is larger than " + std::to_string(kMostHead >> 10) + " KiB");
      return false;
    case Head::kTooLate:
      send_refusal(stream, "408 Request Timeout", "the head of the request did not come in time");
      return false;
  }
  if (has_several_ranges(bytes.substr(0, bytes.find(kHeadEnd)))) {
    send_refusal(stream, "416 Range Not Satisfiable", "ask for one range of bytes at a time");
    return false;
  }
  RequestStream request(stream, std::move(bytes));
  return process(&BoundedServer::process_request, request, [&request](httplib::Request& understood) {
    understood.ranges.clear();  // routes that have files cut them; httplib would cut every answer
    request.go_on();
  });
}

/// Reads until a head is whole, and perhaps what comes with its end. @param bytes all that was read
BoundedServer::Head BoundedServer::read_head(socket_t socket, std::string& bytes) const {
  const std::chrono::duration<double> idle_time(static_cast<double>(read_timeout_sec_));
  const auto begin = HeadClock::now();
  auto heard = begin;
  char piece[4096];
  while (svr_sock_ != INVALID_SOCKET) {  // until it stops
    const auto now = HeadClock::now();
    if (now - begin > head_time_ || now - heard > idle_time) return bytes.empty() ? Head::kGone : Head::kTooLate;
    pollfd watched{socket, POLLIN, 0};
    if (::poll(&watched, 1, kHeadLookMilliseconds) <= 0) continue;
    const ssize_t got = ::recv(socket, piece, sizeof piece, 0);
    if (got < 0) return Head::kGone;
    if (got == 0) return bytes.empty() ? Head::kGone : Head::kWhole;  // httplib says what is missing
    heard = now;
    const std::size_t before = bytes.size();
    bytes.append(piece, static_cast<std::size_t>(got));
    const std::size_t end = bytes.find(kHeadEnd, before < 2 ? 0 : before - 2);
    if (std::min(end, bytes.size()) > kMostHead) return Head::kTooLong;
    if (end != std::string::npos) return Head::kWhole;
  }
  return Head::kGone;
}

bool BoundedServer::process(OfStream request, httplib::Stream& stream, const Setup& setup) {
  bool closed = false;
  return (this->*request)(stream, true, closed, setup);
}

bool BoundedServer::process(OfAddresses request, httplib::Stream& stream, const Setup& setup) {
  std::string remote, local;
  int remote_port = 0, local_port = 0;
  stream.get_remote_ip_and_port(remote, remote_port);
  stream.get_local_ip_and_port(local, local_port);
  bool closed = false;
  return (this->*request)(stream, remote, remote_port, local, local_port, true, closed, setup);
}

}  // namespace anigen::studio
