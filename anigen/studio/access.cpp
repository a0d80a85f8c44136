#include "anigen/studio/access.h"

#include <cstdio>
#include <random>

#include "anigen/core/text.h"

namespace anigen::studio {

namespace {

/// "localhost:8080" → "localhost"; "[::1]:80" → "[::1]".
std::string without_port(const std::string& host) {
  const std::size_t bracket = host.rfind(']'), colon = host.rfind(':');
  const bool has_port =
      colon != std::string::npos && (bracket == std::string::npos ? host.find(':') == colon : colon > bracket);
  return has_port ? host.substr(0, colon) : host;
}

}  // namespace

bool is_loopback(const std::string& host) {
  return host == "127.0.0.1" || host == "localhost" || host == "::1" || host == "[::1]";
}

std::string Access::refusal(const std::string& host, const std::string& origin) const {
  const std::string named = lower_case(host);
  if (loopback_only && !is_loopback(without_port(named)))
    return "the Host header does not name this machine's loopback address; --host ADDRESS serves others";
  if (!origin.empty() && lower_case(origin) != "http://" + named)
    return "the request comes from a page of another site";
  return "";
}

bool Access::admits(const std::string& authorization, const std::string& cookie) const {
  if (token.empty() || authorization == "Bearer " + token) return true;
  const std::string wanted = std::string("; ") + kTokenCookie + "=" + token + ";";
  return ("; " + cookie + ";").find(wanted) != std::string::npos;
}

std::string new_token() {
  std::random_device device;
  std::string token;
  for (int i = 0; i < 4; ++i) {
    char part[16];
    std::snprintf(part, sizeof part, "%08x", static_cast<unsigned>(device()));
    token += part;
  }
  return token;
}

Refusal refusal_of(const AnnouncedBody& body, std::size_t most_bytes) {
  if (!body.transfer.empty()) return {411, "send a Content-Length in place of Transfer-Encoding"};
  if (!body.encoding.empty() && body.encoding != "identity") return {415, "compressed requests are not taken"};
  if (body.length.empty()) return {};
  if (body.length.find_first_not_of("0123456789") != std::string::npos) return {400, "Content-Length is no number"};
  const bool huge = body.length.size() > 15;
  if (huge || std::stoull(body.length) > most_bytes)
    return {413, "the request is larger than " + std::to_string(most_bytes >> 20) + " MiB"};
  return {};
}

}  // namespace anigen::studio
