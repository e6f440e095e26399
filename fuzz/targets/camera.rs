//! Cameras, digital and film, up to the camera that images are oriented with.
#![no_main]

use gable::http::cameras::CameraRequest;
use gable::jobs::film_camera::Templates;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    // a thousand distances are adjusted at great length, which is no fault
    if data.len() > 20_000 {
        return;
    }
    match CameraRequest::parse(data) {
        Ok(CameraRequest::Digital(request)) => drop(request.camera()),
        Ok(CameraRequest::Film(request)) => {
            if let Ok(definition) = request.definition(&Templates::new()) {
                drop(definition.camera(&Templates::new()));
            }
        }
        Err(problem) => assert!(problem.status().is_client_error(), "{problem:?}"),
    }
});
