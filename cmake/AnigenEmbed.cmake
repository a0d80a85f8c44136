# anigen_embed_text(<target> <file> <header> <name>)
#   Compiles a text file into a library: `extern const char* const <name>` is declared by <header>, which is ours and
#   lies in namespace anigen::<folder of the target>. The text must not contain )EMBED".
function(anigen_embed_text target file header name)
  string(REGEX REPLACE "^anigen_" "" folder ${target})
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
  file(READ ${file} text)
  string(CONFIGURE [=[
#include "@header@"

namespace anigen::@folder@ {
const char* const @name@ = R"EMBED(@text@)EMBED";
}
]=] source @ONLY)
  get_filename_component(stem ${file} NAME_WE)
  set(output ${CMAKE_CURRENT_BINARY_DIR}/embedded/${stem}.cpp)
  set(written "")
  if(EXISTS ${output})
    file(READ ${output} written)
  endif()
  if(NOT written STREQUAL source)
    file(WRITE ${output} "${source}")
  endif()
  target_sources(${target} PRIVATE ${output})
endfunction()
