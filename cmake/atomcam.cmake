# What every target of the project shares: warnings as errors, no contraction of floating-point expressions (a
# frame has the same bits on every instruction set), sanitizers of the preset.
add_library(atomcam_options INTERFACE)
target_compile_options(atomcam_options INTERFACE -Wall -Wextra -Wpedantic -Wshadow
                                                 -Werror -ffp-contract=off
                                                 $<$<CXX_COMPILER_ID:Clang>:-Wno-unknown-pragmas>)
target_include_directories(atomcam_options INTERFACE ${PROJECT_SOURCE_DIR}/src)
target_link_libraries(atomcam_options INTERFACE Threads::Threads fmt::fmt)
if(ATOMCAM_SANITIZE)
  target_compile_options(atomcam_options INTERFACE -fsanitize=${ATOMCAM_SANITIZE} -fno-omit-frame-pointer
                                                   -fno-sanitize-recover=all)
  target_link_options(atomcam_options INTERFACE -fsanitize=${ATOMCAM_SANITIZE})
  target_compile_definitions(atomcam_options INTERFACE ATOMCAM_SANITIZED)
endif()

# A folder of src/ as a static library: every .cpp in it, and the floors it stands on.
function(atomcam_library name)
  cmake_parse_arguments(ARG "" "" "USES;LINKS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  if(NOT sources)
    add_library(atomcam_${name} INTERFACE)
    target_link_libraries(atomcam_${name} INTERFACE atomcam_options)
    foreach(other ${ARG_USES})
      target_link_libraries(atomcam_${name} INTERFACE atomcam_${other})
    endforeach()
    return()
  endif()
  add_library(atomcam_${name} STATIC ${sources})
  target_link_libraries(atomcam_${name} PUBLIC atomcam_options)
  foreach(other ${ARG_USES})
    target_link_libraries(atomcam_${name} PUBLIC atomcam_${other})
  endforeach()
  target_link_libraries(atomcam_${name} PRIVATE ${ARG_LINKS})
endfunction()

# The tests of one folder as one executable, tests/<name>/*.cpp; WORKING in the source tree. PROCESSORS: a test that
# streams loses frames beside one that computes.
function(atomcam_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT;PROCESSORS" "USES;LINKS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${name}/*.cpp)
  if(NOT sources)
    return()
  endif()
  add_executable(test_${name} ${sources})
  target_link_libraries(test_${name} PRIVATE atomcam_options GTest::gtest_main ${ARG_LINKS})
  target_include_directories(test_${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  foreach(other ${ARG_USES})
    target_link_libraries(test_${name} PRIVATE atomcam_${other})
  endforeach()
  target_compile_definitions(test_${name} PRIVATE ATOMCAM_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
                             ATOMCAM_BINARY_DIR="${PROJECT_BINARY_DIR}")
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  if(NOT ARG_PROCESSORS)
    set(ARG_PROCESSORS 1)
  endif()
  gtest_discover_tests(test_${name} DISCOVERY_MODE PRE_TEST PROPERTIES TIMEOUT ${ARG_TIMEOUT} PROCESSORS
                                                                       ${ARG_PROCESSORS})
endfunction()
