//! Camera over a Unix socket: frames in, images out.

use std::io;
use std::os::unix::net::UnixStream;

use component_sdk::prelude::*;
use robot_objects::objects::stamp_of_micros;
use robot_objects::retry::Retry;

pub mod frames;

use frames::{Frame, FrameReader};

/// Most frames passed on in one callback: after a pause the backlog is worked off without starving the executor.
const FRAMES_PER_LOOK: usize = 4;

/// Publishes the camera's images.
#[derive(Component)]
#[component(name = "VisionSensor", version = "1.0", periodic = "20ms")]
pub struct VisionSensor {
    /// RGB images.
    #[port]
    image: DataOut<Image>,
    /// Path of the camera's Unix socket.
    #[property(default = "/run/robot/camera.sock")]
    socket: String,
    stream: Option<UnixStream>,
    reader: FrameReader,
    retry: Retry,
}

impl Callbacks for VisionSensor {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.stream.is_none() && !self.retry.is_due(cx.now().as_nanos()) {
            return Ok(());
        }
        match self.look(cx) {
            Ok(()) => cx.device_found(&self.socket),
            Err(loss) => {
                self.stream = None;
                cx.device_lost(&self.socket, &loss);
            }
        }
        Ok(())
    }

    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        self.stream = None;
        Ok(())
    }

    fn reset(&mut self, _: &mut Context<'_>) -> Outcome {
        // After a panic in the middle of a frame nobody knows where the stream stands.
        self.stream = None;
        Ok(())
    }
}

impl VisionSensor {
    /// Passes on the frames that are there, after connecting if need be.
    fn look(&mut self, cx: &Context<'_>) -> io::Result<()> {
        let stream = match &mut self.stream {
            Some(stream) => stream,
            None => {
                let stream = self.stream.insert(connect(&self.socket)?);
                self.reader.restart();
                info!(cx, "camera connected at {}", self.socket);
                stream
            }
        };
        for _ in 0..FRAMES_PER_LOOK {
            let Some(frame) = self.reader.read(stream)? else { break };
            let mut image = self.image.loan();
            fill(&mut image, &frame);
            image.send();
        }
        Ok(())
    }
}

fn connect(socket: &str) -> io::Result<UnixStream> {
    let stream = UnixStream::connect(socket)?;
    stream.set_nonblocking(true)?;
    Ok(stream)
}

fn fill(image: &mut Image, frame: &Frame<'_>) {
    image.header.stamp = stamp_of_micros(frame.time_us);
    image.header.frame_id.set("camera");
    (image.width, image.height, image.step) = (frame.width, frame.height, frame.width * 3);
    image.encoding.set("rgb8");
    image.is_bigendian = 0;
    image.data.assign(frame.pixels);
}

export_components!(VisionSensor);
