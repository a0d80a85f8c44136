#pragma once
#include <httplib.h>
#include <chrono>
#include <functional>
#include <string>

namespace anigen::studio {

/// httplib's server with bounds on the head of a request, which httplib reads before it asks any handler, however long
/// it is and takes. Heads of more than 64 KiB get status 431, those that are not there in time 408, and several ranges
/// 416: httplib would send all of them at once, each a copy of what it answers. One request per connection: an idle
/// browser would else hold a thread. An exception that httplib lets through ends its connection alone.
class BoundedServer : public httplib::Server {
 public:
  /// @param head_time that a client may take to send a head
  explicit BoundedServer(std::chrono::duration<double> head_time) : head_time_(head_time) {}

 private:
  enum class Head { kWhole, kGone, kTooLong, kTooLate };
  using Setup = std::function<void(httplib::Request&)>;
  // Signatures of httplib::Server::process_request(): that of Debian 12, and that of Debian 13.
  using OfStream = bool (httplib::Server::*)(httplib::Stream&, bool, bool&, const Setup&);
  using OfAddresses = bool (httplib::Server::*)(httplib::Stream&, const std::string&, int, const std::string&, int,
                                                bool, bool&, const Setup&);

  bool process_and_close_socket(socket_t socket) override;
  bool serve(httplib::Stream& stream);
  Head read_head(socket_t socket, std::string& bytes) const;
  bool process(OfStream request, httplib::Stream& stream, const Setup& setup);
  bool process(OfAddresses request, httplib::Stream& stream, const Setup& setup);

  std::chrono::duration<double> head_time_;
};

}  // namespace anigen::studio
