#pragma once
#include <map>
#include <stdexcept>
#include <string>

namespace anigen::studio {

/// A request that cannot be met: HTTP status and the sentence of its {"error": …}.
class RequestError : public std::runtime_error {
 public:
  RequestError(int status, const std::string& problem) : std::runtime_error(problem), status_(status) {}
  int status() const { return status_; }

 private:
  int status_;
};

struct Reply {
  int status = 200;
  std::string type = "application/json", body;
  std::map<std::string, std::string> headers;
};

/// A part of a form.
struct Upload {
  std::string name;  ///< of its file as the client says it, a path perhaps; empty: a field
  std::string bytes;
};

/// Parts by their names; of a name twice the first counts.
using Form = std::map<std::string, Upload>;

}  // namespace anigen::studio
