//! Events in, pictures out.

use super::scene::{
    self, Message, MessageSender, SceneFiles, SceneLoader, SceneMessage, ShownScene, SoupSource,
    WindowOptions,
};
use super::screen::Screen;
use super::session::{self, PhotoPlacement, Session};
use glam::{UVec2, Vec2};
use std::path::Path;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};
use trisplat_scene::{Error, Result};
use winit::application::ApplicationHandler;
use winit::error::EventLoopError;
use winit::event::{
    ElementState, KeyEvent, MouseButton, MouseScrollDelta, StartCause, WindowEvent,
};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::WindowId;

/// Movement from which a pressed button drags, px.
const CLICK: f32 = 4.0;
/// Widest soft picture, px: a second or less on a processor.
const SOFT_WIDTH: f32 = 480.0;

/// Opens a window and returns when it is closed.
///
/// # Errors
///
/// No display, no graphics card, the scene cannot be loaded, the device is lost.
pub fn open(options: WindowOptions, files: SceneFiles, loader: SceneLoader) -> Result<()> {
    let remedy = options.remedy;
    let no_window = |e: &EventLoopError| {
        Error::Gpu(format!("no window can be opened: {}; {remedy}", without_place(&e.to_string())))
    };
    let events = EventLoop::<SceneMessage>::with_user_event().build().map_err(|e| no_window(&e))?;
    let proxy = events.create_proxy();
    let mut app =
        App { options, files, loader, proxy, window: None, failure: None, mouse: Mouse::default() };
    events.run_app(&mut app).map_err(|e| no_window(&e))?;
    app.failure.map_or(Ok(()), Err)
}

/// The message of the windowing library, without the file and line of its source.
fn without_place(said: &str) -> &str {
    let reason = said
        .split_once(".rs:")
        .and_then(|(_, place)| place.split_once(": "))
        .map_or(said, |(_, why)| why);
    reason.trim_end_matches('.')
}

struct App {
    options: WindowOptions,
    /// First content.
    files: SceneFiles,
    loader: SceneLoader,
    proxy: EventLoopProxy<SceneMessage>,
    window: Option<(Screen, Session)>,
    failure: Option<Error>,
    mouse: Mouse,
}

#[derive(Default)]
struct Mouse {
    at: Vec2,
    /// The button that is down, where it went down, and whether it has moved since.
    down: Option<(MouseButton, Vec2, bool)>,
}

impl ApplicationHandler<SceneMessage> for App {
    /// A wait that timed out must draw again, to remove a note.
    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let StartCause::ResumeTimeReached { .. } = cause
            && let Some((screen, _)) = &self.window
        {
            screen.window.request_redraw();
        }
    }

    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_some() {
            return;
        }
        match Screen::open(events, &self.options, self.files.title()) {
            Ok(screen) => {
                let sender = MessageSender { proxy: self.proxy.clone(), scene: 0 };
                sender.load(
                    screen.gpu.clone(),
                    screen.groups(),
                    self.loader.clone(),
                    self.files.clone(),
                );
                let session = Session::new(screen.gpu.describe(), self.files.clone());
                screen.window.request_redraw();
                self.window = Some((screen, session));
            }
            Err(error) => self.fail(events, error),
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some((screen, _)) = &mut self.window else { return };
        let response = screen.input.on_window_event(&screen.window, &event);
        // A picture must not request the next one, or a window at rest would draw for ever.
        if response.repaint && event != WindowEvent::RedrawRequested {
            screen.window.request_redraw();
        }
        let result = match event {
            WindowEvent::CloseRequested => return events.exit(),
            WindowEvent::Resized(size) => screen.resize(UVec2::new(size.width, size.height)),
            WindowEvent::RedrawRequested => self.redraw(events),
            // Keys that were held when the window got the focus are not commands.
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
                return self.key(events, &event, response.consumed);
            }
            WindowEvent::DroppedFile(path) => return self.dropped(&path),
            other => return self.pointer(&other, response.consumed),
        };
        if let Err(error) = result {
            self.fail(events, error);
        }
    }

    fn user_event(
        &mut self,
        events: &ActiveEventLoop,
        SceneMessage { scene, message }: SceneMessage,
    ) {
        let Some((screen, session)) = &mut self.window else { return };
        screen.window.request_redraw();
        let context = screen.input.egui_ctx().clone();
        match message {
            Message::Progress(what) => session.notify(what),
            Message::ImportedScene(result) => self.loaded(events, scene, result),
            Message::Changed(Ok(changed)) => session.change(changed),
            Message::Final(Some(what)) => session.status = Some(what),
            Message::Final(None) => events.exit(),
            // Results for a scene that is no longer shown.
            _ if scene != session.scene => {}
            Message::Photo(index, result) => {
                session.decoding = None;
                match result {
                    Ok(picture) => {
                        session.photo = Some((index, session::texture(&context, "photo", &picture)))
                    }
                    Err(error) => {
                        session.settings.photo = PhotoPlacement::Off;
                        session.notify(error.to_string());
                    }
                }
            }
            Message::Soft(camera, picture) => {
                let texture = session::texture(&context, "soft", &picture);
                session.soft = Some((camera, texture, picture));
                session.soft_is_old = false;
            }
            Message::Rested => session.drawing_soft = false,
            Message::Cropped(Ok(model)) => {
                session.cropped = Some(Arc::from(model));
                session.cropping = false;
            }
            Message::SavedCrop(Ok(what)) => session.notify(what),
            Message::Saved(Ok(path)) => session.notify(format!("saved {}", path.display())),
            Message::Changed(Err(error))
            | Message::Cropped(Err(error))
            | Message::SavedCrop(Err(error))
            | Message::Saved(Err(error)) => {
                session.notify(error.to_string());
            }
        }
    }
}

impl App {
    fn fail(&mut self, events: &ActiveEventLoop, error: Error) {
        self.failure.get_or_insert(error);
        events.exit();
    }

    /// Shows the loaded scene. A failed first scene is an error; a failed dropped file keeps the
    /// present scene.
    fn loaded(&mut self, events: &ActiveEventLoop, scene: u32, result: Result<Box<ShownScene>>) {
        let Some((screen, session)) = &mut self.window else { return };
        session.loading = None;
        match result {
            Ok(loaded) => {
                session.scene = scene;
                screen.window.set_title(&loaded.files.title());
                session.show(loaded);
                if scene == 0 {
                    let sender = MessageSender { proxy: self.proxy.clone(), scene };
                    let files = self.files.clone();
                    sender.follow(screen.gpu.clone(), screen.groups(), &self.loader, files);
                }
            }
            Err(error) if session.shown.is_some() => session.notify(error.to_string()),
            Err(error) => self.fail(events, error),
        }
    }

    /// Loads a scene, or photos of the shown one.
    fn dropped(&mut self, path: &Path) {
        let Some((screen, session)) = &mut self.window else { return };
        screen.window.request_redraw();
        if session.loading.is_some() {
            return session.notify(
                "another file is being loaded: drop this one again when it is shown".into(),
            );
        }
        let scene = session.next_number();
        session.loading = Some(scene);
        session.notify("loading".into());
        let sender = MessageSender { proxy: self.proxy.clone(), scene };
        let files = session.files.with_dropped(path);
        sender.load(screen.gpu.clone(), screen.groups(), self.loader.clone(), files);
    }

    /// The channel for messages about the shown scene.
    fn sender(&self) -> MessageSender {
        let scene = self.window.as_ref().map_or(0, |(_, session)| session.scene);
        MessageSender { proxy: self.proxy.clone(), scene }
    }

    fn redraw(&mut self, events: &ActiveEventLoop) -> Result<()> {
        let Some((screen, session)) = &mut self.window else { return Ok(()) };
        let secs = session.meter.tick(!session.keys.is_empty() || self.mouse.down.is_some());
        session.controls.fly(&session.keys, secs as f32);
        let again = screen.draw(session)?;
        self.start_work();
        let Some((screen, session)) = &self.window else { return Ok(()) };
        let moving = !session.keys.is_empty() || again.is_zero();
        if moving {
            screen.window.request_redraw();
        }
        let wakes = !moving && again < Duration::from_secs(3600);
        let at = Instant::now().checked_add(again).filter(|_| wakes);
        events.set_control_flow(at.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
        Ok(())
    }

    /// Starts the background work for the picture.
    fn start_work(&mut self) {
        let sender = self.sender();
        let Some((screen, session)) = &mut self.window else { return };
        let region = session.region();
        let Some(shown) = &mut session.shown else { return };
        if let Some(index) = session.current
            && session.settings.photo != PhotoPlacement::Off
            && session.decoding.is_none()
            && session.photo.as_ref().is_none_or(|(shown, _)| *shown != index)
            && let Some(photo) = shown.scene.photos.get(index)
        {
            session.decoding = Some(index);
            let load = photo.load.clone();
            sender.spawn(move || Message::Photo(index, load()));
        }
        if session.settings.soft
            && let Some(camera) = session.camera
        {
            let scale = (SOFT_WIDTH / session.pane.size.x).min(1.0);
            let small = (session.pane.size * scale).round().max(Vec2::ONE);
            let mut of_pane = camera;
            of_pane.center -= session.pane.min;
            of_pane.size = session.pane.size.round().as_uvec2().max(UVec2::ONE);
            let wanted = of_pane.resized(small.as_uvec2());
            let is_drawn = session.soft.as_ref().is_some_and(|(drawn, ..)| *drawn == wanted);
            if (!is_drawn || session.soft_is_old)
                && !session.drawing_soft
                && let Some(SoupSource { renderer, rest }) = shown.scene.source.clone()
            {
                session.drawing_soft = true;
                let messages = sender.clone();
                sender.spawn(move || {
                    let clock = Instant::now();
                    let picture = renderer.lock().unwrap_or_else(PoisonError::into_inner)(&wanted);
                    messages.send(Message::Soft(wanted, picture));
                    std::thread::sleep(clock.elapsed().mul_f64(rest));
                    Message::Rested
                });
            }
        }
        if let Some(wanted) = region
            && !session.cropping
            && session.cropped_to != region
        {
            let gpu = screen.gpu.clone();
            let groups = screen.groups();
            let asset = shown.scene.asset.clone();
            let placement = shown.scene.placement;
            session.cropped_to = region;
            session.cropping = true;
            let part = move || scene::cropped(&gpu, &groups, &asset, &placement, &wanted);
            sender.spawn(move || Message::Cropped(part().map(Box::new)));
        }
        if std::mem::take(&mut session.saving_crop)
            && let Some(region) = shown.crop.region()
        {
            let save = shown.scene.save_crop.clone();
            sender.spawn(move || Message::SavedCrop(save(&region)));
        }
    }

    /// A key; what is `typed` into a field is no command.
    fn key(&mut self, events: &ActiveEventLoop, event: &KeyEvent, typed: bool) {
        let Some((screen, session)) = &mut self.window else { return };
        let PhysicalKey::Code(code) = event.physical_key else { return };
        screen.window.request_redraw();
        match event.state {
            ElementState::Released => drop(session.keys.remove(&code)),
            ElementState::Pressed if !typed && session.keys.insert(code) => {
                self.press(events, code)
            }
            ElementState::Pressed => {}
        }
    }

    fn press(&mut self, events: &ActiveEventLoop, code: KeyCode) {
        let Some((_, session)) = &mut self.window else { return };
        let settings = &mut session.settings;
        match code {
            KeyCode::Escape => events.exit(),
            KeyCode::KeyF => session.frame(),
            KeyCode::KeyN => session.step(1),
            KeyCode::KeyP => session.step(-1),
            KeyCode::KeyO => session.next_photo_placement(),
            KeyCode::KeyH => settings.no_panel = !settings.no_panel,
            KeyCode::Digit3 => settings.wireframe = !settings.wireframe,
            KeyCode::Digit4 => {
                settings.soft = !settings.soft
                    && session.shown.as_ref().is_some_and(|s| s.scene.source.is_some())
            }
            KeyCode::KeyX => {
                if let Some(shown) = &mut session.shown {
                    shown.crop.on = !shown.crop.on;
                }
            }
            KeyCode::Enter | KeyCode::NumpadEnter => session.saving_crop = true,
            KeyCode::F12 => self.screenshot(),
            _ => {}
        }
    }

    fn pointer(&mut self, event: &WindowEvent, consumed: bool) {
        let Some((screen, session)) = &mut self.window else { return };
        let height = screen.window.inner_size().height.max(1) as f32;
        match *event {
            WindowEvent::CursorMoved { position, .. } => {
                let at = Vec2::new(position.x as f32, position.y as f32);
                let drag = (at - self.mouse.at) / height;
                self.mouse.at = at;
                if let Some((button, from, moved)) = &mut self.mouse.down {
                    *moved |= at.distance(*from) > CLICK;
                    if *moved {
                        match *button {
                            MouseButton::Left => session.controls.orbit(drag),
                            MouseButton::Right => session.controls.turn(drag),
                            _ => session.controls.pan(drag),
                        }
                        screen.window.request_redraw();
                    }
                }
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, button, .. } if !consumed => {
                self.mouse.down = Some((button, self.mouse.at, false));
            }
            WindowEvent::MouseInput { state: ElementState::Released, .. } => self.mouse.down = None,
            WindowEvent::Focused(false) => session.keys.clear(),
            WindowEvent::MouseWheel { delta, .. } if !consumed => {
                let steps = match delta {
                    MouseScrollDelta::LineDelta(_, y) => y,
                    MouseScrollDelta::PixelDelta(by) => by.y as f32 / 60.0,
                };
                session.controls.zoom(steps);
                screen.window.request_redraw();
            }
            WindowEvent::PinchGesture { delta, .. } if delta.is_finite() => {
                session.controls.zoom(8.0 * delta as f32);
                screen.window.request_redraw();
            }
            _ => {}
        }
    }

    /// Saves a picture without the panel.
    fn screenshot(&mut self) {
        let sender = self.sender();
        let Some((screen, session)) = &self.window else { return };
        let Some(model) = session.model().cloned() else { return };
        // The current camera: the last picture may still show the one before.
        let size = screen.window.inner_size();
        let params = session.frame_params(UVec2::new(size.width, size.height), &self.options);
        let folder = self.options.screenshots.clone();
        if session.settings.soft
            && let Some((_, _, soft)) = &session.soft
        {
            let picture = soft.clone();
            sender.spawn(move || Message::Saved(scene::save(&folder, &picture)));
            return;
        }
        let gpu = screen.gpu.clone();
        let draw = move || scene::draw_screenshot(&gpu, &model, &params);
        sender.spawn(move || Message::Saved(draw().and_then(|p| scene::save(&folder, &p))));
    }
}
