# A lean build, for training and sampling where only LibTorch is to be had: headers, libzip and zlib beside it
# (docs/cluster.md says what it lacks). ANIGEN_LEAN is a compile definition of all its sources, too.
#
# A source that calls a library which a lean build does without is named after it. Another one stands in for it there:
# `_stb` and `_plain` by other means, which all builds compile, `_lean` by saying what is not supported. The module
# anigen-opencv (anigen/apps/with_opencv) is not there either.

if(ANIGEN_LEAN)
  set(ANIGEN_LEFT_OUT "(_opencv|_embree|_libraries|/assimp|/assimp_mesh|/assimp_scene)[.]cpp$")
  # The programs and libraries that need more.
  foreach(option ANIGEN_WITH_CGAL ANIGEN_WITH_PYTHON ANIGEN_BUILD_TESTS ANIGEN_BUILD_BENCHMARKS ANIGEN_BUILD_FUZZ_REPLAY)
    set(${option} OFF)
  endforeach()
else()
  set(ANIGEN_LEFT_OUT "_lean[.]cpp$")
endif()

# anigen_leave_out(<sources variable> <libraries variable>)
#   Drops what this kind of build does without.
macro(anigen_leave_out sources libraries)
  list(FILTER ${sources} EXCLUDE REGEX "${ANIGEN_LEFT_OUT}")
  if(ANIGEN_LEAN AND DEFINED ${libraries})
    list(FILTER ${libraries} EXCLUDE REGEX "^(embree|opencv_.*|TBB::tbb)$")
  endif()
endmacro()
