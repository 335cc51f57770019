// What may stand on the stage besides the body itself. A module that brings a way of looking
// pushes it here: {name, offered(page), open(page), close(page), tools(page), cards(page),
// draw(page), press, move, release, key (page, event) → true if taken}; all but `name` and
// `offered` may be left out. What undo and links shall carry of it lies in page.look, as JSON.

export const MODES = [];

/** The modes that a page offers now. */
export const offered = (page) => MODES.filter((mode) => mode.offered(page));
