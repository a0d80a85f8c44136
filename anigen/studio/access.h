#pragma once
#include <cstddef>
#include <string>

namespace anigen::studio {

inline constexpr const char* kTokenCookie = "anigen_token";

/// 128 random bits, hexadecimal.
std::string new_token();

/// Rules by which a server takes requests, from their headers alone. A page of another site, or one whose name was made
/// to point at this machine (DNS rebinding), must not drive a server that listens on the loopback network.
struct Access {
  bool loopback_only = true;  ///< the server listens on 127.0.0.1, ::1 or localhost
  std::string token;          ///< that a request must carry; empty: none

  /// @param host, origin headers; an empty origin: none was sent @return why the request is refused; empty: it is not
  std::string refusal(const std::string& host, const std::string& origin) const;
  /// The request carries the token, or none is asked for. @param authorization "Bearer TOKEN" @param cookie header with
  /// kTokenCookie=TOKEN among others
  bool admits(const std::string& authorization, const std::string& cookie) const;
};

/// An address of this machine's loopback network, without a port.
bool is_loopback(const std::string& host);

/// Body of a request as its headers announce it.
struct AnnouncedBody {
  std::string length;    ///< Content-Length; empty: not sent
  std::string transfer;  ///< Transfer-Encoding
  std::string encoding;  ///< Content-Encoding
};

struct Refusal {
  int status = 0;  ///< 0: none
  std::string problem;
};

/// Refuses, before any of it is read, a body that is larger than allowed, of a length that is not said, or compressed,
/// whose size nobody knows.
Refusal refusal_of(const AnnouncedBody& body, std::size_t most_bytes);

}  // namespace anigen::studio
