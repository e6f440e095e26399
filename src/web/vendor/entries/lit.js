export { html, svg, nothing, render } from 'lit-html';
export { classMap } from 'lit-html/directives/class-map.js';
export { ifDefined } from 'lit-html/directives/if-defined.js';
export { live } from 'lit-html/directives/live.js';
export { ref, createRef } from 'lit-html/directives/ref.js';
export { repeat } from 'lit-html/directives/repeat.js';
