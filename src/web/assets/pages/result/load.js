// All that the API knows of an orientation, as far as it is there.

import { api, Problem } from '../../api.js';
import { notify } from '../../parts/notices.js';
import { problemText } from '../../texts.js';
import { isUnderway } from './live.js';

// what does not exist (404), not yet (409) or no longer (410) is left out; of all else the user is told
function absent(error) {
  if (error.name === 'AbortError') return undefined;
  if (!(error instanceof Problem && [404, 409, 410].includes(error.status))) notify(problemText(error), 'error');
  return undefined;
}

/** `{orientation, image, camera, drawing, map, reviews}`. */
export async function load(id, signal) {
  const orientation = await api.get(`/orientations/${id}`, { signal });
  const get = (path, query) => api.get(path, { signal, query }).catch(absent);
  const done = !isUnderway(orientation) && orientation.result;
  const [image, camera, drawing, map, reviews] = await Promise.all([
    get(`/images/${orientation.image}`), get(`/cameras/${orientation.camera}`),
    done ? get(`/orientations/${id}/drawing`) : undefined, done ? get(`/orientations/${id}/map`) : undefined,
    get(`/orientations/${id}/reviews`, { limit: 200 }),
  ]);
  return { orientation, image, camera, drawing, map, reviews: reviews?.items };
}
