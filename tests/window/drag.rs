//! Drags a file from a window of its own onto another, as file managers do (the XDND protocol,
//! version 5).

use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    ClientMessageEvent, ConnectionExt, CreateWindowAux, EventMask, PropMode,
    SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, SelectionRequestEvent, Window, WindowClass,
};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// Drops the file that `uri` names on window `target` of `display`.
pub(crate) fn drop_on(display: &str, target: Window, uri: &str) {
    let (x11, screen) = x11rb::connect(Some(display)).unwrap();
    let screen = &x11.setup().roots[screen];
    let source = x11.generate_id().unwrap();
    let aux = CreateWindowAux::new();
    let class = WindowClass::INPUT_OUTPUT;
    x11.create_window(0, source, screen.root, 0, 0, 1, 1, 0, class, screen.root_visual, &aux)
        .unwrap();
    let drag = Drag { source, target, uri: format!("{uri}\r\n"), x11: &x11 };
    x11.set_selection_owner(source, drag.atom("XdndSelection"), 0u32).unwrap();
    let list = drag.atom("text/uri-list");
    drag.say("XdndEnter", [5 << 24, list, 0, 0]);
    drag.say("XdndPosition", [0, 10 << 16 | 10, 0, drag.atom("XdndActionCopy")]);
    drag.answer_until("XdndStatus");
    drag.say("XdndDrop", [0, 0, 0, 0]);
    drag.answer_until("XdndFinished");
}

struct Drag<'a> {
    source: Window,
    target: Window,
    uri: String,
    x11: &'a RustConnection,
}

impl Drag<'_> {
    fn atom(&self, name: &str) -> u32 {
        self.x11.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom
    }

    fn say(&self, what: &str, [a, b, c, d]: [u32; 4]) {
        let event =
            ClientMessageEvent::new(32, self.target, self.atom(what), [self.source, a, b, c, d]);
        self.x11.send_event(false, self.target, EventMask::NO_EVENT, event).unwrap();
        self.x11.flush().unwrap();
    }

    /// Hands out the list of files when it is asked for, until the target has said `what` and has
    /// the list.
    fn answer_until(&self, what: &str) {
        let start = Instant::now();
        let wanted = self.atom(what);
        let mut said = false;
        let mut given = what != "XdndStatus";
        while !(said && given) {
            assert!(start.elapsed() < Duration::from_secs(60), "waited in vain for {what}");
            match self.x11.poll_for_event().unwrap() {
                Some(Event::SelectionRequest(request)) => {
                    self.give(&request);
                    given = true;
                }
                Some(Event::ClientMessage(message)) => said |= message.type_ == wanted,
                Some(_) => {}
                None => std::thread::sleep(Duration::from_millis(10)),
            }
        }
        // The target reads the list when it hears of it.
        std::thread::sleep(Duration::from_millis(200));
    }

    fn give(&self, request: &SelectionRequestEvent) {
        let to = request.requestor;
        let property = request.property;
        let bytes = self.uri.as_bytes();
        self.x11.change_property8(PropMode::REPLACE, to, property, request.target, bytes).unwrap();
        let event = SelectionNotifyEvent {
            response_type: SELECTION_NOTIFY_EVENT,
            sequence: 0,
            time: request.time,
            requestor: to,
            selection: request.selection,
            target: request.target,
            property,
        };
        self.x11.send_event(false, to, EventMask::NO_EVENT, event).unwrap();
        self.x11.flush().unwrap();
    }
}
